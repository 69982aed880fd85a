//! Checks of the documents and of the help: their commands, options and settings exist.

use crate::config::Preset;
use crate::program::Cli;
use crate::program::args::Command as Subcommand;
use crate::program::evaluation::{Method, ablation};
use clap::error::ErrorKind;
use clap::{Command, CommandFactory, Parser};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Flags of Cargo in the prose.
const CARGO_FLAGS: [&str; 3] = ["--example", "--features", "--no-default-features"];

/// Names and texts of README and documents; none where the crate is not in its workspace.
fn documents() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let patterns = ["*.md", "docs/*.md", "*/README.md"].map(|pattern| root.join(pattern));
    let paths = patterns.iter().flat_map(|pattern| glob::glob(pattern.to_str().unwrap()).unwrap());
    paths.flatten().map(|path| (path.display().to_string(), fs::read_to_string(path).unwrap())).collect()
}

/// The words of a script's simple commands, with pipes, lists and redirections between words, and no more of the shell.
fn commands(script: &str) -> Vec<Vec<String>> {
    let script = script.replace("\\\n", " ");
    let words = |line: &str| shlex::split(line).unwrap_or_else(|| panic!("{line}: quotes that do not close"));
    let simple = |words: Vec<String>| -> Vec<Vec<String>> {
        words.split(|word| ["|", "&&", ";"].contains(&&**word)).map(<[_]>::to_vec).collect()
    };
    script.lines().map(words).flat_map(simple).filter(|words| !words.is_empty()).collect()
}

/// The examples in a command's help and its subcommands'.
fn examples(command: &Command) -> Vec<String> {
    let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let own = help.lines().filter(|line| line.starts_with("  mde ")).map(|line| line.trim().to_owned());
    own.chain(command.get_subcommands().flat_map(examples)).collect()
}

/// Parses a command of the program, also one that Cargo starts, with its names of methods and rows. Other programs' are false.
fn is_taken(words: &[String]) -> Result<bool, String> {
    let start = match &*words[0] {
        "mde" => Some(0),
        "cargo" if words.iter().any(|word| word == "mde-cli") => words.iter().position(|word| word == "--"),
        _ => None,
    };
    let Some(start) = start else { return Ok(false) };
    let end = words.iter().position(|word| word == ">").unwrap_or(words.len());
    match Cli::try_parse_from(&words[start..end]).map_err(|error| error.to_string())?.command {
        Subcommand::Eval(args) => {
            for name in args.methods.iter().filter(|name| !name.ends_with(".toml")) {
                Method::parse(name, None).map_err(|error| format!("{error:#}"))?;
            }
        }
        Subcommand::Ablate(args) => {
            let unknown = args.rows.iter().find(|name| ablation::ROWS.iter().all(|row| row.name != **name));
            unknown.map_or(Ok(()), |name| Err(format!("--rows {name}: no such row")))?;
        }
        _ => {}
    }
    Ok(true)
}

#[test]
fn commands_and_settings_of_the_documents_and_the_help_are_taken() {
    let examples = examples(&Cli::command());
    assert!(examples.len() > 25, "only {} examples were found", examples.len());
    let mut scripts = vec![("the help".to_owned(), examples.join("\n"))];
    for (path, text) in documents() {
        let blocks = text.split("```").skip(1).step_by(2).filter_map(|block| block.strip_prefix("sh\n"));
        scripts.extend(blocks.map(|script| (path.clone(), script.to_owned())));
    }
    let (mut known, mut settings) = (0, 0);
    for (path, script) in &scripts {
        for words in commands(script) {
            let fault = |error| panic!("{path}: {}\n{error}", words.join(" "));
            known += usize::from(is_taken(&words).unwrap_or_else(fault));
            if let [printf, text, _, to] = words.as_slice()
                && printf == "printf"
                && to.ends_with(".toml")
            {
                settings += 1;
                Preset::Default.config().with_text(&text.replace("\\n", "\n"), to).unwrap();
            }
        }
    }
    let enough = known >= examples.len() + 20 && settings >= 3;
    assert!(enough || scripts.len() == 1, "only {known} and {settings} were found");
    for wrong in ["eval --dataset rooms --methods jfb", "ablate --rows no-varience", "demo --sized 64x48"] {
        assert!(is_taken(&commands(&format!("mde {wrong} -o out"))[0]).is_err(), "{wrong}");
    }
}

#[test]
fn commands_and_options_in_the_prose_exist() {
    let mut program = Cli::command();
    program.build();
    let options: BTreeSet<String> = std::iter::once(&program)
        .chain(program.get_subcommands())
        .flat_map(Command::get_arguments)
        .filter_map(|argument| Some(format!("--{}", argument.get_long()?)))
        .collect();
    let documents = documents();
    let mut known = 0;
    for (path, text) in &documents {
        assert!(text.split("```").count() % 2 == 1, "{path}: a block is not closed");
        // A code span may run over a line's end, but not over a paragraph's.
        let paragraphs = text.split("```").step_by(2).flat_map(|prose| prose.split("\n\n"));
        for span in paragraphs.flat_map(|paragraph| paragraph.split('`').skip(1).step_by(2)) {
            let words: Vec<_> = span.split_whitespace().filter(|word| *word != "...").collect();
            if words.first() == Some(&"mde") && words.len() > 1 {
                known += 1;
                // Prose names a command without what it needs.
                let lacks = [ErrorKind::MissingRequiredArgument, ErrorKind::DisplayHelp];
                if let Err(error) = Cli::try_parse_from(&words) {
                    assert!(lacks.contains(&error.kind()), "{path}: {span}\n{error}");
                }
            } else if words.first().is_some_and(|word| word.starts_with("--")) {
                known += 1;
                for flag in words.into_iter().filter(|word| word.len() > 2 && word.starts_with("--")) {
                    assert!(options.contains(flag) || CARGO_FLAGS.contains(&flag), "{path}: {span}");
                }
            }
        }
    }
    assert!(known >= 40 || documents.is_empty(), "only {known} were found");
}
