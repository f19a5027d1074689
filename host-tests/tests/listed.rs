//! The lists of unsafe code, docs/unsafe.md and the file of that name in the folder of each board, are complete, and every unsafe
//! block has a SAFETY comment.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The keyword in two parts, so that the test does not find itself.
const KEYWORD: &str = concat!("un", "safe");

/// The folders with Rust sources. Some may be absent.
const FOLDERS: [&str; 13] = [
    "src",
    "bluetooth",
    "boards",
    "mcumgr",
    "platform",
    "emulation",
    "proofs",
    "tools",
    "host-tests",
    "fuzz",
    "examples",
    "testkit",
    "python",
];

/// The folder of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Adds all Rust sources below a folder to `found`.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("the folder can be read").flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_dir() && !["target", "node_modules"].iter().any(|other| name == *other) {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// All Rust sources of the repository.
pub fn all_sources() -> Vec<PathBuf> {
    let mut files = Vec::new();
    for folder in FOLDERS.map(|folder| root().join(folder)).iter().filter(|folder| folder.is_dir()) {
        sources(folder, &mut files);
    }
    files
}

/// A line without its comment.
fn code(line: &str) -> &str {
    line.split_once("//").map_or(line, |(code, _)| code)
}

fn has_keyword(line: &str) -> bool {
    code(line).split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == KEYWORD)
}

#[test]
fn every_unsafe_line_is_listed_and_every_unsafe_block_has_a_safety_comment() {
    let mut found = BTreeMap::new();
    for file in all_sources() {
        let text = fs::read_to_string(&file).expect("the source can be read");
        let lines: Vec<_> = text.lines().collect();
        let count = lines.iter().filter(|line| has_keyword(line)).count();
        let name = file.strip_prefix(root()).expect("the file is below the root").to_string_lossy().replace('\\', "/");
        for (i, _) in lines.iter().enumerate().filter(|(_, line)| code(line).contains(&format!("{KEYWORD} {{"))) {
            let comment = lines[..i].iter().rev().take_while(|line| line.trim().starts_with("//"));
            assert!(comment.into_iter().any(|line| line.contains("SAFETY:")), "{name}:{} has no SAFETY comment", i + 1);
        }
        if count > 0 {
            found.insert(name, count);
        }
    }
    let list = |folder: &str| fs::read_to_string(root().join(folder).join(format!("{KEYWORD}.md")));
    let mut all = list("docs").expect("the list can be read");
    for board in fs::read_dir(root().join("boards")).expect("there are boards").flatten() {
        // A board without a list has no such code.
        all += &list(&board.path().to_string_lossy()).unwrap_or_default();
    }
    let listed: BTreeMap<_, usize> = all
        .lines()
        .filter_map(|row| {
            let mut cells = row.split('|').map(str::trim).skip(1);
            let (file, lines) = (cells.next()?, cells.next()?);
            file.ends_with(".rs").then(|| (file.to_owned(), lines.parse().expect("the row contains a number of lines")))
        })
        .collect();
    assert_eq!(found, listed, "docs/{KEYWORD}.md or the list of a board differs from the sources: correct the list");
}
