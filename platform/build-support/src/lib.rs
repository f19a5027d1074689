//! Code that the build scripts share: the memory regions of a board, the check of the update key, and the version.

use plantar::storage::flash_map::{ACTIVE, BOOTLOADER, HEADER, HEADER_BYTES};
pub use plantar::storage::flash_map::{NRF52_FLASH, STM32_FLASH};
use plantar::storage::update::DEVELOPMENT_KEY;
use std::fmt::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// Size of the stack, bytes: more than twice its deepest measured use, which occurs while pairing.
const STACK_BYTES: u32 = 20 << 10;
/// Size of the region that contains the crash record and the stack of the fault handler, bytes.
const CRASH_RECORD_BYTES: u32 = 1 << 10;

/// The two programs of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// The application, which the bootloader starts.
    Application,
    /// The bootloader.
    Bootloader,
}

/// A further memory region of a board. Its section has the same name in lower case, after a dot (`.mailbox` for `MAILBOX`).
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// Name in capitals, such as `MAILBOX`.
    pub name: &'static str,
    /// First address.
    pub origin: u32,
    /// Size, bytes.
    pub bytes: u32,
}

/// Links the binaries of the package under build as `program` of a board with this RAM; `flash` is the first address of the
/// controller's own flash. Writes `regions.x`, which the `memory.x` of the workspace includes, and passes these scripts to the
/// linker: that of `cortex-m-rt`; for an application, also that of `defmt` and one that places the image header; and, if there
/// are further `regions`, one with their sections. Also sets the environment variable `PLANTAR_VERSION`, see [`version`].
pub fn link(program: Program, flash: u32, ram: Range<u32>, regions: &[Region]) {
    let offsets = match program {
        Program::Application => ACTIVE,
        Program::Bootloader => BOOTLOADER,
    };
    let flash = flash + offsets.start..flash + offsets.end;
    let ram_start = ram.start + STACK_BYTES;
    let crash_record = ram.end - CRASH_RECORD_BYTES;
    let mut text = String::new();
    let mut region = |name: &str, origin: u32, end: u32| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name} : ORIGIN = {origin:#x}, LENGTH = {:#x}", end - origin);
    };
    region("FLASH", flash.start, flash.end);
    region("STACK", ram.start, ram_start);
    region("RAM", ram_start, crash_record);
    region("CRASH_RECORD", crash_record, ram.end);
    let mut sections = String::from("SECTIONS\n{\n");
    for Region { name, origin, bytes } in regions {
        region(name, *origin, origin + bytes);
        let section = name.to_lowercase();
        let _ = writeln!(sections, "  .{section} (NOLOAD) : ALIGN(4) {{ KEEP(*(.{section})) }} > {name}");
    }
    sections.push_str("} INSERT AFTER .uninit;\n");
    let folder = out_dir();
    write(&folder.join("regions.x"), &text);
    println!("cargo:rustc-link-search={}", folder.display());
    if program == Program::Application {
        let header = flash.start + HEADER;
        let script = format!(
            "_stext = {:#x};\nSECTIONS {{ .header {header:#x} : {{ KEEP(*(.header)) }} > FLASH }} INSERT AFTER .vector_table\n",
            header + HEADER_BYTES
        );
        write(&folder.join("header.x"), &script);
        println!("cargo:rustc-link-arg-bins=-Theader.x");
        println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    }
    if !regions.is_empty() {
        write(&folder.join("sections.x"), &sections);
        println!("cargo:rustc-link-arg-bins=-Tsections.x");
    }
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rerun-if-changed={}", root().join("memory.x").display());
    version();
}

/// Requires that `PLANTAR_UPDATE_KEY` is another key than the development key, unless the feature `development-key` of the
/// package under build is enabled.
///
/// # Panics
/// If this requirement is not met. The panic ends the build, and its message states the remedy.
pub fn require_update_key() {
    println!("cargo:rerun-if-env-changed=PLANTAR_UPDATE_KEY");
    let key = env::var("PLANTAR_UPDATE_KEY").ok();
    if let Err(error) = check_update_key(key.as_deref(), env::var_os("CARGO_FEATURE_DEVELOPMENT_KEY").is_some()) {
        panic!("{error}");
    }
}

/// Checks the key with which updates must be signed; `None` stands for the development key.
///
/// # Errors
/// If it is the development key and `is_development_allowed` is false. The text states the remedy.
pub fn check_update_key(key: Option<&str>, is_development_allowed: bool) -> Result<(), String> {
    let is_development = key.is_none_or(|key| key.eq_ignore_ascii_case(DEVELOPMENT_KEY));
    if is_development && !is_development_allowed {
        return Err("this firmware would accept updates signed with the development key, of which the private key is public: set \
             PLANTAR_UPDATE_KEY to the key that `cargo xtask key --out insole.key` prints, or, for a board that only you use, \
             build with `--features development-key`"
            .into());
    }
    Ok(())
}

/// Sets the environment variable `PLANTAR_VERSION` for the package under build: the version of the package and, if the sources
/// are a git checkout, the commit, as in `0.2.0+1a2b3c4`. Only the three numbers decide which of two versions is newer.
pub fn version() {
    // Cargo always sets this variable.
    let version = env::var("CARGO_PKG_VERSION").unwrap_or_default();
    let commit = git(&["rev-parse", "--short=7", "HEAD"]).map_or(String::new(), |commit| format!("+{commit}"));
    println!("cargo:rustc-env=PLANTAR_VERSION={version}{commit}");
    // The log of HEAD changes with every commit and checkout.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo:rerun-if-changed={}", root().join(log).display());
    }
    println!("cargo:rerun-if-changed=build.rs");
}

/// The text that git prints; `None` if git is missing, the sources are not a checkout, or the text is empty.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).current_dir(root()).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned()).filter(|text| !text.is_empty())
}

/// The folder of the workspace.
fn root() -> PathBuf {
    // This package is two folders below the folder of the workspace.
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new(".")).into()
}

/// The folder for the output of the build script.
fn out_dir() -> PathBuf {
    // Cargo always sets this variable.
    PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default())
}

/// Writes a file.
///
/// # Panics
/// If the file cannot be written, which ends the build with the reason.
fn write(path: &Path, text: &str) {
    fs::write(path, text).unwrap_or_else(|error| panic!("cannot write {}: {error}", path.display()));
}

#[cfg(test)]
mod tests {
    use super::{DEVELOPMENT_KEY, check_update_key};

    #[test]
    fn the_development_key_is_refused_unless_a_feature_allows_it() {
        let own = "ab".repeat(32);
        for is_allowed in [false, true] {
            assert_eq!(check_update_key(Some(&own), is_allowed), Ok(()));
            for key in [None, Some(DEVELOPMENT_KEY), Some(&*DEVELOPMENT_KEY.to_uppercase())] {
                assert_eq!(check_update_key(key, is_allowed).is_ok(), is_allowed, "{key:?}");
            }
        }
        assert!(check_update_key(None, false).is_err_and(|error| error.contains("PLANTAR_UPDATE_KEY")));
    }
}
