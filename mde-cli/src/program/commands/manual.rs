//! `mde completions` and `mde man`.

use crate::program::{command, print};
use anyhow::{Context, Result};
use clap_complete::Shell;
use clap_mangen::Man;

pub(super) fn completions(shell: Shell) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut command(), "mde", &mut text);
    print(&text)
}

pub(super) fn page(name: Option<&str>) -> Result<()> {
    let mut program = command();
    // Gives the subcommands their whole names.
    program.build();
    let page = match name {
        None => program,
        Some(name) => {
            let found = program.find_subcommand(name).filter(|found| found.get_name() != "help").cloned();
            let names: Vec<_> = program.get_subcommands().map(|c| c.get_name().to_owned()).collect();
            let found = found
                .with_context(|| format!("{name}: no such command; give one of {}", names.join(", ")))?;
            let name = format!("mde-{}", found.get_name());
            found.display_name(name)
        }
    };
    let mut text = Vec::new();
    let source = concat!("mde ", env!("CARGO_PKG_VERSION"));
    Man::new(page).source(source).render(&mut text).context("the manual page can't be made")?;
    print(&text)
}
