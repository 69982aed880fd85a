//! Checks of the documents: commands, options, settings, files and examples exist.

use crate::config::{Config, Preset};
use crate::program::args::Cli;
use crate::program::args::Command as Subcommand;
use crate::program::evaluation::ablation;
use crate::program::evaluation::method::Method;
use clap::error::ErrorKind;
use clap::{Command, CommandFactory, Parser};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Flags of Cargo in the prose.
const CARGO_FLAGS: [&str; 3] = ["--example", "--features", "--no-default-features"];

/// README and documents; none where the crate is not in its workspace.
fn documents() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let patterns = ["*.md", "docs/*.md", "*/README.md"].map(|pattern| root.join(pattern));
    let paths = patterns.iter().flat_map(|pattern| glob::glob(pattern.to_str().unwrap()).unwrap());
    paths.map(|path| path.unwrap()).map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect()
}

/// A document's fenced blocks with their languages, and the paragraphs between them.
fn split(text: &str) -> (Vec<(String, String)>, Vec<String>) {
    let (mut blocks, mut prose) = (Vec::new(), vec![String::new()]);
    let mut block: Option<(String, String)> = None;
    for line in text.lines() {
        match (line.strip_prefix("```"), &mut block) {
            (Some(_), Some(_)) => blocks.extend(block.take()),
            (Some(language), None) => block = Some((language.to_owned(), String::new())),
            (None, Some((_, inside))) => *inside += &format!("{line}\n"),
            // A code span may run over a line's end, but not over a paragraph's.
            (None, None) if line.trim().is_empty() => prose.push(String::new()),
            (None, None) => *prose.last_mut().unwrap() += &format!("{line} "),
        }
    }
    assert!(block.is_none(), "a block is not closed");
    (blocks, prose)
}

fn blocks_in(language: &str) -> Vec<(PathBuf, String)> {
    let of = |(path, text): (PathBuf, String)| {
        let blocks = split(&text).0.into_iter().filter(|(name, _)| name == language);
        blocks.map(move |(_, block)| (path.clone(), block)).collect::<Vec<_>>()
    };
    documents().into_iter().flat_map(of).collect()
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

/// Parses a command of the program, also one that Cargo starts, and checks what the parser leaves to the command: names of methods and
/// rows. Other programs' are false.
fn is_taken(words: &[String]) -> Result<bool, String> {
    let start = match &*words[0] {
        "mde" => 0,
        "cargo" if words.iter().any(|word| word == "mde-cli") => {
            match words.iter().position(|word| word == "--") {
                Some(end) => end,
                None => return Ok(false),
            }
        }
        _ => return Ok(false),
    };
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
fn commands_and_settings_of_the_documents_are_taken() {
    let (mut known, mut settings) = (0, 0);
    for (path, script) in blocks_in("sh") {
        for words in commands(&script) {
            let taken = is_taken(&words);
            let fault = |error| panic!("{}: {}\n{error}", path.display(), words.join(" "));
            known += u32::from(taken.unwrap_or_else(fault));
            if let [printf, text, _, to] = words.as_slice()
                && printf == "printf"
                && to.ends_with(".toml")
            {
                settings += 1;
                Config::with_overrides(Preset::Default, &text.replace("\\n", "\n"), to).unwrap();
            }
        }
    }
    assert!(known >= 20 && settings >= 3 || documents().is_empty(), "only {known} and {settings} were found");
    for wrong in ["eval --dataset rooms --methods jfb", "ablate --rows no-varience", "demo --sized 64x48"] {
        assert!(is_taken(&commands(&format!("mde {wrong} -o out"))[0]).is_err(), "{wrong}");
    }
}

#[test]
fn examples_of_the_help_are_taken() {
    let examples = examples(&Cli::command());
    assert!(examples.len() > 25, "only {} examples were found", examples.len());
    for example in examples {
        for words in commands(&example) {
            is_taken(&words).unwrap_or_else(|error| panic!("{example}\n{error}"));
        }
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
    let mut known = 0;
    for (path, text) in documents() {
        let paragraphs = split(&text).1;
        let spans = paragraphs.iter().flat_map(|paragraph| paragraph.split('`').skip(1).step_by(2));
        for span in spans {
            let words: Vec<_> = span.split_whitespace().filter(|word| *word != "...").collect();
            let place = || format!("{}: {span}", path.display());
            if words.first() == Some(&"mde") && words.len() > 1 {
                known += 1;
                // Prose names a command without what it needs.
                let lacks = [ErrorKind::MissingRequiredArgument, ErrorKind::DisplayHelp];
                if let Err(error) = Cli::try_parse_from(&words) {
                    assert!(lacks.contains(&error.kind()), "{}\n{error}", place());
                }
            } else if words.first().is_some_and(|word| word.starts_with("--")) {
                known += 1;
                for flag in words.into_iter().filter(|word| word.len() > 2 && word.starts_with("--")) {
                    assert!(options.contains(flag) || CARGO_FLAGS.contains(&flag), "{}", place());
                }
            }
        }
    }
    assert!(known >= 40 || documents().is_empty(), "only {known} were found");
}

#[test]
fn source_files_in_the_documents_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut known = 0;
    for (path, text) in documents() {
        for span in text.split('`').filter(|span| span.starts_with("mde-") && span.ends_with(".rs")) {
            known += 1;
            assert!(root.join(span).is_file(), "{}: {span}", path.display());
        }
    }
    assert!(known >= 20 || documents().is_empty(), "only {known} were found");
}

/// An example that is not compiled may be wrong.
#[test]
fn every_document_with_an_example_is_compiled() {
    for (path, _) in blocks_in("rust") {
        let name = path.file_name().unwrap().to_string_lossy();
        let (library, included) = match path.parent().unwrap().ends_with("docs") {
            true => (Path::new(env!("CARGO_MANIFEST_DIR")).to_owned(), format!("../../docs/{name}")),
            false => (path.parent().unwrap().to_owned(), "../README.md".to_owned()),
        };
        let text = fs::read_to_string(library.join("src/lib.rs")).unwrap_or_default();
        assert!(text.contains(&format!("\"{included}\"")), "{}: include it in lib.rs", path.display());
    }
}
