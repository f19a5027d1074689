//! Shows the origin of firmware: builds that can be repeated, and lists of all dependencies.

use crate::command::{run, run_command};
use crate::{BOARDS, TARGET, build, image, setup};
use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// A copy of the last commit in a temporary folder, which is deleted with this value.
struct CommitCopy(TempDir);

impl CommitCopy {
    /// Copies the last commit. The name of the folder begins with `prefix`.
    fn of_last_commit(prefix: &str) -> Result<Self> {
        let folder = tempfile::Builder::new().prefix(prefix).tempdir()?;
        run("git", &["clone", "--quiet", ".", &folder.path().to_string_lossy()])?;
        Ok(Self(folder))
    }

    /// Runs a command in the copy, with a target folder of its own.
    fn run(&self, command: &mut Command) -> Result<()> {
        run_command(command.current_dir(self.0.path()).env("CARGO_TARGET_DIR", self.0.path().join("target")))
    }
}

/// Builds firmware and bootloaders of all boards in two folders with paths of different lengths, and compares them.
pub fn reproduce() -> Result<()> {
    setup::rust()?;
    let packages: Vec<String> = BOARDS.iter().flat_map(|board| [build::bootloader(board), (*board).into()]).collect();
    let build = |name: &str| -> Result<Vec<Vec<u8>>> {
        let copy = CommitCopy::of_last_commit(name)?;
        packages.iter().try_for_each(|package| copy.run(&mut build::firmware_command("build", package)?))?;
        let loaded = |package: &String| {
            let firmware = copy.0.path().join("target").join(TARGET).join("firmware").join(package);
            image::segments(&firmware, &copy.0.path().join("loaded"))
        };
        packages.iter().map(loaded).collect()
    };
    let (first, second) = (build("plantar")?, build("plantar-another-folder")?);
    for ((package, first), second) in packages.iter().zip(&first).zip(&second) {
        if first != second {
            // If all common bytes are equal, one build is longer: the builds differ from the end of the shorter one on.
            let at = first.iter().zip(second).position(|(first, second)| first != second);
            let at = at.unwrap_or(first.len().min(second.len()));
            bail!("{package} differs between two builds of the same commit, from byte {at} on");
        }
        println!("{package}: {} bytes, equal in both builds", first.len());
    }
    Ok(())
}

/// Writes a bill of materials for the firmware of each board, and one for the command line, to `out`.
pub fn write_sboms(out: &Path) -> Result<()> {
    let tool = setup::cargo_cyclonedx()?;
    std::fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    let out = std::path::absolute(out)?;
    // The tool writes its files beside each Cargo.toml, so it runs in a copy.
    let copy = CommitCopy::of_last_commit("plantar-sbom")?;
    let write = |target: &[&str], packages: &[(&str, &str)]| -> Result<()> {
        let arguments = ["cyclonedx", "--format", "json", "--spec-version", "1.5", "--quiet"];
        copy.run(Command::new(&tool).args(arguments).args(target))?;
        for (folder, package) in packages {
            let file = format!("{package}.cdx.json");
            let text = std::fs::read_to_string(copy.0.path().join(folder).join(&file))
                .with_context(|| format!("cargo-cyclonedx has not written {folder}/{file}"))?;
            // The identifiers of this repository's packages contain the folder of the copy.
            std::fs::write(out.join(&file), text.replace(&*copy.0.path().to_string_lossy(), "/plantar"))?;
            println!("{}", out.join(file).display());
        }
        Ok(())
    };
    let folders: Vec<String> = BOARDS.iter().map(|board| format!("boards/{board}")).collect();
    let boards: Vec<_> = folders.iter().map(String::as_str).zip(BOARDS).collect();
    write(&["--target", TARGET], &boards)?;
    // A release has the command line for several systems, which need different libraries.
    write(&["--target", "all"], &[("tools/plantar", "plantar-cli")])
}
