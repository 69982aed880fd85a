use crate::program::args::ConfigArgs;
use anyhow::Result;
use std::io::{self, ErrorKind, Write};

pub(super) fn run(args: &ConfigArgs) -> Result<()> {
    let text = args.preset.config().to_toml()?;
    match io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}
