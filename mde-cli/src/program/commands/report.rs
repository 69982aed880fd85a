use crate::program::args::ReportArgs;
use crate::program::report;
use crate::program::terminal::line_of;
use anyhow::Result;
use std::io::{self, Write};

pub(super) fn run(args: &ReportArgs) -> Result<()> {
    let path = report::write(&args.folder)?;
    // A closed pipe is no error.
    let _ = writeln!(io::stdout().lock(), "wrote {}", line_of(&path));
    Ok(())
}
