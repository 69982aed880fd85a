//! Arguments of what is written: the folder, the files for other programs, the progress.

use crate::output::export::{FORMATS, Format};
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Files for other programs.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Output")]
pub(crate) struct ExportArgs {
    /// Also write files for other programs, separated by commas
    #[arg(long, value_name = "FORMATS", value_delimiter = ',', value_parser = formats(false))]
    pub(crate) export: Vec<Format>,
}

/// The formats by their names, with or without those of a whole capture.
pub(crate) fn formats(whole: bool) -> impl TypedValueParser<Value = Format> {
    let refused = move |format: Format| format.is_of_capture() && !whole;
    let values =
        FORMATS.map(|(format, name, about)| PossibleValue::new(name).help(about).hide(refused(format)));
    PossibleValuesParser::new(values).try_map(move |name| match name.parse::<Format>() {
        Ok(format) if refused(format) => {
            Err(format!("is of a whole capture: mde dense CAPTURE --export {name}"))
        }
        parsed => parsed.map_err(|error| error.to_string()),
    })
}

/// Output folder and progress.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output")]
pub(crate) struct RunArgs {
    /// Output folder; by default one in the working folder, with the input's name
    #[arg(short, long, value_name = "DIR", help_heading = None::<&'static str>, display_order = 0)]
    pub(crate) output: Option<PathBuf>,
    /// Replace the folder of an earlier run
    #[arg(long)]
    pub(crate) force: bool,
    /// Number of threads; default: all cores. The results do not depend on it
    #[arg(long, help_heading = "Advanced", value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Print errors only
    #[arg(short, long, conflicts_with = "log_json")]
    pub(crate) quiet: bool,
    /// Progress, warnings and results as JSON lines on stderr
    #[arg(long, help_heading = "Advanced")]
    pub(crate) log_json: bool,
}

impl RunArgs {
    /// The output, by default the name of `input` without its extension and with this ending, in the working folder.
    pub(crate) fn output(&self, input: &Path, ending: &str) -> PathBuf {
        self.output.clone().unwrap_or_else(|| {
            let full =
                || std::path::absolute(input).ok().and_then(|path| path.file_stem().map(OsStr::to_owned));
            // A folder such as `..` has a name in its full path only.
            let mut name =
                input.file_stem().map(OsStr::to_owned).or_else(full).unwrap_or_else(|| "mde".into());
            name.push(ending);
            name.into()
        })
    }
}
