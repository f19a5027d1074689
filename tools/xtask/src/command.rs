//! Runs programs in the repository's folder.

use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::ScopedJoinHandle;
use std::time::Instant;

/// The repository's folder.
pub fn root() -> PathBuf {
    // This package is in the folder tools/xtask of the repository.
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new(".")).into()
}

/// A path in cargo's target folder.
pub fn built(path: &str) -> PathBuf {
    // All programs run in the repository's folder, so a relative path begins there.
    root().join(std::env::var_os("CARGO_TARGET_DIR").unwrap_or("target".into())).join(path)
}

/// Runs a program in the repository's folder. Returns an error if the program fails.
pub fn run(program: &str, arguments: &[&str]) -> Result<()> {
    run_command(Command::new(program).args(arguments))
}

/// Prints a command, runs it in the repository's folder unless `command` sets another folder, and prints its duration. Returns an
/// error if the command fails.
pub fn run_command(command: &mut Command) -> Result<()> {
    let words: Vec<_> = std::iter::once(command.get_program()).chain(command.get_args()).collect();
    let line = words.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ");
    eprintln!("> {line}");
    if command.get_current_dir().is_none() {
        command.current_dir(root());
    }
    let start = Instant::now();
    let status = command.status().with_context(|| format!("cannot run {line}"))?;
    if !status.success() {
        bail!("{line} failed");
    }
    // The line is repeated, because some commands run at the same time.
    eprintln!("< {:.1} s: {line}", start.elapsed().as_secs_f64());
    Ok(())
}

/// Waits for the result of a task that runs in another thread. If the task panicked, this panics too.
pub fn join<T>(task: ScopedJoinHandle<'_, Result<T>>) -> Result<T> {
    task.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
