//! Checks of the documents: commands, options, settings, files and examples exist.

use crate::config::{Config, Preset};
use crate::program::args::Cli;
use crate::program::args::Command as Subcommand;
use crate::program::evaluation::ablation;
use crate::program::evaluation::method::Method;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, CommandFactory, Parser};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Flags of Cargo in the prose.
const CARGO_FLAGS: [&str; 3] = ["--example", "--features", "--no-default-features"];

/// README and documents; none where the crate is not in its workspace.
#[allow(clippy::print_stderr)]
fn documents() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    if !root.join("docs").is_dir() {
        eprintln!("skipped: the documents are not in the package");
        return Vec::new();
    }
    let markdown = |folder: &Path| -> Vec<PathBuf> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        entries.filter(|path| path.extension().is_some_and(|e| e == "md")).collect()
    };
    let crates = fs::read_dir(&root).unwrap().map(|entry| entry.unwrap().path());
    let mut paths = [markdown(&root), markdown(&root.join("docs"))].concat();
    paths.extend(crates.map(|folder| folder.join("README.md")).filter(|path| path.is_file()));
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect()
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

/// A simple command: its words, and the file that its output goes to.
#[derive(Debug, Default, PartialEq)]
struct Simple {
    words: Vec<String>,
    to: Option<String>,
}

/// The simple commands of a script, with pipes, lists and redirections to files between words, and no more of the shell.
fn commands(script: &str) -> Vec<Simple> {
    let mut all = Vec::new();
    for line in script.replace("\\\n", " ").lines() {
        let words = shlex::split(line).unwrap_or_else(|| panic!("{line}: quotes that do not close"));
        for words in words.split(|word| ["|", "&&", "&", ";"].contains(&&**word)) {
            let mut simple = Simple::default();
            let mut words = words.iter().cloned();
            while let Some(word) = words.next() {
                match &*word {
                    ">" => simple.to = words.next(),
                    _ => simple.words.push(word),
                }
            }
            all.push(simple);
        }
    }
    all.retain(|command| !command.words.is_empty());
    all
}

/// The words from `mde` on, also where Cargo starts it.
fn of_program(words: &[String]) -> Option<Vec<String>> {
    if words[0] == "mde" {
        return Some(words.to_vec());
    }
    let starts =
        words.starts_with(&["cargo".to_owned(), "run".to_owned()]) && words.iter().any(|w| w == "mde-cli");
    let end = words.iter().position(|word| word == "--")?;
    starts.then(|| [&["mde".to_owned()], &words[end + 1..]].concat())
}

/// The examples in a command's help and its subcommands'.
fn examples(command: &Command) -> Vec<String> {
    let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let own = help.lines().filter(|line| line.starts_with("  mde ")).map(|line| line.trim().to_owned());
    own.chain(command.get_subcommands().flat_map(examples)).collect()
}

/// Parses, with the first of the possible values where a word in capitals stands for any of them.
fn parse(words: &[String]) -> clap::error::Result<Cli> {
    let error = match Cli::try_parse_from(words) {
        Err(error) if error.kind() == ErrorKind::InvalidValue => error,
        result => return result,
    };
    let (Some(ContextValue::String(wrong)), Some(ContextValue::Strings(possible))) =
        (error.get(ContextKind::InvalidValue), error.get(ContextKind::ValidValue))
    else {
        return Err(error);
    };
    match possible.first() {
        Some(first) if wrong.len() > 2 && wrong.chars().all(|letter| letter.is_ascii_uppercase()) => parse(
            &words.iter().map(|word| if word == wrong { first } else { word }.clone()).collect::<Vec<_>>(),
        ),
        _ => Err(error),
    }
}

/// Also what the parser leaves to the command: names of methods and rows.
fn check(words: &[String]) -> Result<(), String> {
    let cli = parse(words).map_err(|error| error.to_string())?;
    match cli.command {
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
    Ok(())
}

#[test]
fn command_lines_of_the_documents_are_taken() {
    let documents = documents();
    let mut known = 0;
    for (path, script) in blocks_in("sh") {
        for command in commands(&script) {
            if let Some(words) = of_program(&command.words) {
                known += 1;
                check(&words)
                    .unwrap_or_else(|error| panic!("{}: {}\n{error}", path.display(), words.join(" ")));
            }
        }
    }
    assert!(known >= 20 || documents.is_empty(), "only {known} commands were found");
}

#[test]
fn examples_of_the_help_are_taken() {
    let mut command = Cli::command();
    command.build();
    let examples = examples(&command);
    assert!(examples.len() > 25, "only {} examples were found", examples.len());
    for example in examples {
        for simple in commands(&example).into_iter().filter(|simple| simple.words[0] == "mde") {
            check(&simple.words).unwrap_or_else(|error| panic!("{example}\n{error}"));
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
        for paragraph in split(&text).1 {
            for span in paragraph.split('`').skip(1).step_by(2) {
                let words = span.split_whitespace().filter(|word| *word != "...").map(str::to_owned);
                let words: Vec<_> = words.collect();
                let place = || format!("{}: {span}", path.display());
                if words.first().is_some_and(|word| word == "mde") && words.len() > 1 {
                    known += 1;
                    // Prose names a command without what it needs.
                    let lacks = [ErrorKind::MissingRequiredArgument, ErrorKind::DisplayHelp];
                    if let Err(error) = parse(&words) {
                        assert!(lacks.contains(&error.kind()), "{}\n{error}", place());
                    }
                } else if words.first().is_some_and(|word| word.starts_with("--")) {
                    known += 1;
                    for flag in words.iter().filter(|word| word.len() > 2 && word.starts_with("--")) {
                        assert!(
                            options.contains(flag) || CARGO_FLAGS.contains(&flag.as_str()),
                            "{}",
                            place()
                        );
                    }
                }
            }
        }
    }
    assert!(known >= 40 || documents().is_empty(), "only {known} were found");
}

#[test]
fn settings_in_the_documents_are_settings() {
    let mut known = 0;
    for (path, script) in blocks_in("sh") {
        for command in commands(&script) {
            let (Some(to), [printf, text]) = (&command.to, command.words.as_slice()) else { continue };
            if printf == "printf" && to.ends_with(".toml") {
                known += 1;
                let place = format!("{}: {to}", path.display());
                Config::with_overrides(Preset::Default, &text.replace("\\n", "\n"), &place).unwrap();
            }
        }
    }
    assert!(known >= 3 || documents().is_empty(), "only {known} were found");
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
    let compiled = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    for (path, _) in blocks_in("rust") {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.parent().is_some_and(|folder| folder.ends_with("docs")) {
            assert!(compiled.contains(&format!("../../docs/{name}")), "{name}: name it in lib.rs");
        } else {
            let lib = fs::read_to_string(path.with_file_name("src").join("lib.rs")).unwrap_or_default();
            assert!(
                lib.contains("include_str!(\"../README.md\")"),
                "{}: include it in lib.rs",
                path.display()
            );
        }
    }
}

#[test]
fn scripts_are_taken_apart() {
    let words = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
    let script = "mde a --b \\\n  'c d' # not && this\nprintf 'x = \"#1\"\\n' > f.toml && mde e | man -l -\n";
    let expected = [
        Simple { words: vec!["mde".into(), "a".into(), "--b".into(), "c d".into()], to: None },
        Simple { words: vec!["printf".into(), "x = \"#1\"\\n".into()], to: Some("f.toml".into()) },
        Simple { words: words("mde e"), to: None },
        Simple { words: words("man -l -"), to: None },
    ];
    assert_eq!(commands(script), expected);
    assert_eq!(
        of_program(&words("cargo run --release -p mde-cli -- demo -o x")),
        Some(words("mde demo -o x"))
    );
    assert_eq!(of_program(&words("cargo test")), None);
    assert!(check(&words("mde eval --dataset rooms --methods jfb -o out")).is_err());
    assert!(check(&words("mde ablate --dataset rooms --rows no-varience -o out")).is_err());
    assert!(check(&words("mde demo --sized 64x48 -o out")).is_err());
    assert!(check(&words("mde demo --preset PRESET -o out")).is_ok());
    assert!(check(&words("mde demo --preset fats -o out")).is_err());
    let (blocks, prose) = split("a `b\nc`\n\n```sh\nd\n```\ne\n");
    assert_eq!((blocks.len(), prose.len(), prose[0].as_str()), (1, 2, "a `b c` "));
}
