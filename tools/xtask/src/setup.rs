//! Installs missing programs and data, or prints the package to install by hand.

use crate::TARGET;
use crate::command::{root, run, run_command};
use anyhow::{Context, Result, bail};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The Python package with the sample walk. It is licensed under GPLv3, so it is stored only in the private cache, and never in
/// the repository. Its dependencies are not installed, because the importer only reads its data files.
const SAMPLE_PACKAGE: &str = "jiku-data==0.1.16";
/// The Python package with walks recorded by Moticon's insoles. Only its source archive contains the walks. It is stored in the
/// private cache, too.
const WALKS_PACKAGE: &str = "moticon-opengo";
const WALKS_VERSION: &str = "1.0.3";
const NUMPY: &str = "numpy>=1.26,<3";
const SCIPY: &str = "scipy>=1.13,<2";
/// A library that simulates phones and Bluetooth controllers.
const BUMBLE: &str = "bumble==0.0.236";

/// The packages that build and test the Python package.
const PACKAGE_TOOLS: [&str; 15] = [
    "cryptography==50.0.2",
    "dask==2026.8.0",
    "distributed==2026.8.0",
    "fsspec==2026.9.0",
    "ipykernel==7.4.0",
    "matplotlib==3.11.2",
    "maturin==1.16.0",
    "mypy==2.4.1",
    "nbclient==0.11.0",
    "numpy==2.4.6",
    "pandas==3.1.1",
    "pandas-stubs==3.1.0.261029",
    "pyarrow==26.0.1",
    "pytest==9.2.0",
    "xarray==2026.9.0",
];

/// Packages that read exported files and live streams, for tests: C3D, OpenSim's storage files, MATLAB files, BIDS, CSV, MCAP
/// and the Lab Streaming Layer, whose library liblsl is part of pylsl. One environment has all of them. The list contains the
/// dependencies that the tests need; no others are installed.
const FORMAT_READERS: [&str; 14] = [
    "ezc3d==1.7.2",
    "c3d==0.6.0",
    "opensim==4.6",
    "scipy==1.17.1",
    "numpy==2.4.6",
    "pandas==3.1.1",
    "python-dateutil==4.0.0",
    "tzdata==2026.6",
    "bids-validator-deno==3.0.2",
    "deno==2.9.8",
    "mcap==1.6.0",
    "lz4==4.4.5",
    "zstandard==0.25.0",
    "pylsl==1.18.6",
];

/// The client of management tools (MCUmgr), with serial port and Bluetooth. It needs another version of bumble than [`BUMBLE`],
/// so it has an environment of its own.
const MANAGEMENT_CLIENT: [&str; 2] = ["smpclient[serial,bumble]==7.3.0", "smp==4.2.0"];

/// The library of the C compiler Clang that `bindgen` loads, from PyPI because no compiler has to be installed for it.
const LIBCLANG: &str = "libclang==18.1.1";

/// A private Python environment.
pub struct Python {
    /// The path of its interpreter, which has NumPy, SciPy and bumble.
    pub interpreter: PathBuf,
    /// The path of the source archive with walks recorded by Moticon's insoles.
    pub moticon: PathBuf,
}

/// Installs all programs and data that the builds, the demonstration, the tests and the benchmarks need, except the npm packages
/// of the page, which [`crate::page::install`] installs.
pub fn all() -> Result<()> {
    for_tests()?;
    cargo_deny().map(drop)
}

/// As [`all`], but without cargo-deny, which checks the dependencies. What the builds need comes first, because they may run at
/// the same time.
pub fn for_tests() -> Result<Python> {
    rust()?;
    libclang()?;
    node()?;
    package()?;
    qemu()?;
    ngspice()?;
    chromium()?;
    bus()?;
    octave()?;
    formats()?;
    management()?;
    sample()?;
    let python = python()?;
    nextest()?;
    Ok(python)
}

/// Held while a package of the system or a Python environment is installed: threads that need the same one at the same time would
/// install it twice, and package managers do not run twice at the same time.
static INSTALLATION: Mutex<()> = Mutex::new(());

/// Waits until no other thread installs anything.
fn installation() -> MutexGuard<'static, ()> {
    // A thread that panicked leaves an incomplete installation, which is repeated.
    INSTALLATION.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The private folder for downloads, and for files that are made from them.
pub fn cache() -> PathBuf {
    root().join(".cache")
}

/// True if the program can be started.
pub fn has(program: &str) -> bool {
    Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}

/// The folder of the pinned toolchain.
pub fn sysroot() -> Result<PathBuf> {
    let rustc = Command::new("rustc").args(["--print", "sysroot"]).current_dir(root()).output();
    let sysroot = rustc.context("rustc does not start: install rustup from https://rustup.rs")?;
    if !sysroot.status.success() {
        bail!("rustc --print sysroot failed: {}", String::from_utf8_lossy(&sysroot.stderr).trim());
    }
    Ok(String::from_utf8(sysroot.stdout)?.trim().into())
}

/// Installs the targets and components of the pinned toolchain. rustup usually does this itself, but users can disable that.
pub fn rust() -> Result<()> {
    let sysroot = sysroot()?;
    let targets = [TARGET, "wasm32-unknown-unknown"];
    let has_program =
        |name: &str| sysroot.join("bin").join(name).with_extension(std::env::consts::EXE_EXTENSION).is_file();
    let has_targets = targets.into_iter().all(|target| sysroot.join("lib/rustlib").join(target).is_dir());
    if !(has_targets && ["clippy-driver", "rustfmt"].into_iter().all(has_program)) {
        run("rustup", &[&["target", "add"], &targets[..]].concat())
            .and_then(|()| run("rustup", &["component", "add", "clippy", "rustfmt"]))
            .context("rustup cannot complete the toolchain in rust-toolchain.toml: check the network connection")?;
    }
    Ok(())
}

/// Installs QEMU for Arm.
pub fn qemu() -> Result<()> {
    if has("qemu-system-arm") {
        return Ok(());
    }
    install(&OsPackage {
        title: "QEMU for Arm (qemu-system-arm)",
        apt: "qemu-system-arm",
        dnf: "qemu-system-arm",
        pacman: "qemu-system-arm",
        brew: "qemu",
    })
}

/// Installs ngspice, which simulates the front end of the reference board.
pub fn ngspice() -> Result<()> {
    if has("ngspice") {
        return Ok(());
    }
    install(&OsPackage { title: "ngspice", apt: "ngspice", dnf: "ngspice", pacman: "ngspice", brew: "ngspice" })
}

/// Installs GDB for Arm, and returns the name of the program.
pub fn gdb() -> Result<&'static str> {
    let knows_arm = |program: &&str| {
        let mut command = Command::new(program);
        command.args(["--batch", "--nx", "-ex", "set architecture armv7e-m"]);
        command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
    };
    let find = || ["gdb-multiarch", "arm-none-eabi-gdb", "gdb"].into_iter().find(knows_arm);
    if let Some(program) = find() {
        return Ok(program);
    }
    install(&OsPackage {
        title: "GDB for Arm",
        apt: "gdb-multiarch",
        dnf: "gdb",
        pacman: "arm-none-eabi-gdb",
        brew: "arm-none-eabi-gdb",
    })?;
    find().context("the installed GDB does not know the architecture armv7e-m")
}

/// The oldest major version of Node.js that the page's tools support.
const NODE_MAJOR: u32 = 18;

/// Installs Node.js with npm, for the page.
pub fn node() -> Result<()> {
    if !has("node") || !has("npm") {
        let named = |apt, other| OsPackage { title: "Node.js with npm", apt, dnf: other, pacman: other, brew: "node" };
        // If only npm is missing, only npm is installed. Homebrew has both in the package `node`.
        install(&if has("node") { named("npm", "npm") } else { named("nodejs npm", "nodejs npm") })?;
    }
    let version = Command::new("node").arg("--version").output().context("Node.js does not start")?;
    let version = String::from_utf8_lossy(&version.stdout).trim().to_string();
    let major = version.trim_start_matches('v').split('.').next().and_then(|major| major.parse::<u32>().ok());
    if major.is_none_or(|major| major < NODE_MAJOR) {
        bail!(
            "the page needs Node.js {NODE_MAJOR} or newer, but {version} is installed: see \
             https://nodejs.org/en/download"
        );
    }
    Ok(())
}

/// Installs a browser, for the tests of reports and of the page.
pub fn chromium() -> Result<()> {
    if ["chromium", "chromium-browser", "google-chrome"].into_iter().any(has) {
        return Ok(());
    }
    install(&OsPackage {
        title: "Chromium",
        // Debian's Chromium only recommends fonts, and recommended packages are not installed.
        apt: "chromium fonts-liberation",
        dnf: "chromium",
        pacman: "chromium",
        brew: "chromium",
    })
}

/// Installs cargo-fuzz and the C++ compiler that libFuzzer needs. Returns the path of cargo-fuzz.
pub fn cargo_fuzz() -> Result<PathBuf> {
    if !has("c++") {
        install(&OsPackage { title: "A C++ compiler", apt: "g++", dnf: "gcc-c++", pacman: "gcc", brew: "gcc" })?;
    }
    cargo_tool("cargo-fuzz", "0.13.2")
}

/// Installs cargo-deny, which checks licences, sources and advisories of the dependencies. Returns its path.
pub fn cargo_deny() -> Result<PathBuf> {
    cargo_tool("cargo-deny", "0.20.2")
}

/// Installs cargo-nextest, which runs the tests of all packages at the same time, unless the user has it: the options used here
/// are the same in all versions. Returns a command that lacks only its subcommand, such as `run`.
pub fn nextest() -> Result<Command> {
    let user = "cargo-nextest";
    let mut command = Command::new(if has(user) { user.into() } else { cargo_tool(user, "0.9.143")? });
    command.arg("nextest");
    Ok(command)
}

/// Installs cargo-cyclonedx, which writes software bills of materials. Returns its path.
pub fn cargo_cyclonedx() -> Result<PathBuf> {
    cargo_tool("cargo-cyclonedx", "0.5.9")
}

/// Installs cargo-llvm-cov, which measures the lines that tests execute, and the component of the toolchain that it needs.
/// Returns its path.
pub fn cargo_llvm_cov() -> Result<PathBuf> {
    run("rustup", &["component", "add", "llvm-tools"])
        .context("rustup cannot install llvm-tools, which measures coverage: check the network connection")?;
    cargo_tool("cargo-llvm-cov", "0.9.1")
}

/// Installs cargo-mutants, which makes small changes to the library, one at a time, and runs the tests with each of them.
/// Returns its path.
pub fn cargo_mutants() -> Result<PathBuf> {
    cargo_tool("cargo-mutants", "27.1.0")
}

/// The toolchain that has Miri, an interpreter that finds undefined behaviour. Nothing else uses it.
pub const MIRI_TOOLCHAIN: &str = "nightly-2026-10-30";

/// Installs [`MIRI_TOOLCHAIN`].
pub fn miri() -> Result<()> {
    let components = ["--component", "miri", "--component", "rust-src"];
    run("rustup", &[&["toolchain", "install", MIRI_TOOLCHAIN, "--profile", "minimal"], &components[..]].concat())
        .context("rustup cannot install the toolchain with Miri: check the network connection")
}

/// Installs exactly this version of a tool in the private cache. A version that the user has installed is neither used nor
/// changed.
fn cargo_tool(name: &str, version: &str) -> Result<PathBuf> {
    let folder = cache().join("cargo");
    let tool = folder.join("bin").join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    // The list of the programs that cargo has installed in this folder.
    let installed = std::fs::read_to_string(folder.join(".crates.toml")).unwrap_or_default();
    if !tool.is_file() || !installed.contains(&format!("\"{name} {version} (")) {
        let tool = format!("{name}@{version}");
        // Without optimisation and debug information, the tool compiles faster and is fast enough.
        let mut command = Command::new("cargo");
        command.args(["install", "--locked", "--debug", "--root", &folder.to_string_lossy(), &tool]);
        run_command(command.env("CARGO_PROFILE_DEV_DEBUG", "none"))
            .with_context(|| format!("{tool} comes from the Rust package registry: check the network connection"))?;
    }
    Ok(tool)
}

/// Installs libclang in the private cache. Returns two environment variables, by which `bindgen` finds libclang and the headers
/// that every C compiler has, such as `stdint.h`. The package of libclang lacks these headers, so those of the system's C
/// compiler are used, which Rust needs anyway.
pub fn libclang() -> Result<[(&'static str, OsString); 2]> {
    let environment = cache().join("libclang");
    environment_with(&environment, LIBCLANG, || {
        pip(&environment, &["install", "--no-deps", LIBCLANG])
            .context("libclang comes from PyPI: check the network connection")
    })?;
    let library = find(&environment, Path::new("clang/native"))
        .with_context(|| format!("{LIBCLANG} lacks its library: remove {} and try again", environment.display()))?;
    // Both GCC and Clang have this option.
    let headers = Command::new("cc")
        .arg("-print-file-name=include")
        .output()
        .context("the C compiler cc does not start: install it (Debian: apt-get install gcc libc6-dev)")?;
    let headers = String::from_utf8(headers.stdout)?;
    let arguments = format!("-ffreestanding '-I{}'", headers.trim());
    Ok([("LIBCLANG_PATH", library.into()), ("BINDGEN_EXTRA_CLANG_ARGS", arguments.into())])
}

/// Installs D-Bus on Linux, for a test that simulates the system's Bluetooth service.
fn bus() -> Result<()> {
    if !cfg!(target_os = "linux") || has("dbus-daemon") {
        return Ok(());
    }
    install(&OsPackage { title: "D-Bus", apt: "dbus-daemon", dnf: "dbus-daemon", pacman: "dbus", brew: "dbus" })
}

/// Installs GNU Octave, which reads exported MATLAB files in a test.
fn octave() -> Result<()> {
    if has("octave-cli") {
        return Ok(());
    }
    install(&OsPackage { title: "GNU Octave", apt: "octave", dnf: "octave", pacman: "octave", brew: "octave" })
}

/// The file in a Python environment with the list of the packages that were installed.
const PYTHON_STAMP: &str = "installed-packages.txt";

/// Creates the private Python environment, if it is missing or the list of its packages has changed.
pub fn python() -> Result<Python> {
    let environment = cache().join("python");
    let walks = format!("{WALKS_PACKAGE}=={WALKS_VERSION}");
    let packages = format!("{walks} {NUMPY} {SCIPY} {BUMBLE}");
    let sources = environment.join("sources");
    let interpreter = program(&environment, "python");
    environment_with(&environment, &packages, || {
        let pip = |options: &[&str]| pip(&environment, options);
        let (source, folder) = (["--no-deps", "--no-binary", WALKS_PACKAGE, &walks], sources.to_string_lossy());
        pip(&["install", "--no-deps", NUMPY, SCIPY])
            .and_then(|()| pip(&["install", BUMBLE]))
            .and_then(|()| pip(&[&["download", "--dest", &folder], &source[..]].concat()))
            .context("the walks, NumPy, SciPy and bumble come from PyPI: check the network connection")
    })?;
    let moticon = sources.join(format!("{}-{WALKS_VERSION}.tar.gz", WALKS_PACKAGE.replace('-', "_")));
    Ok(Python { interpreter, moticon })
}

/// Installs the data set with the sample walk in the private cache. Returns its path. It has an environment of its own, because
/// the demonstration needs nothing else from PyPI.
pub fn sample() -> Result<PathBuf> {
    let remedy = "the sample walk comes from PyPI: check the network connection";
    let environment = environment_of("sample", &[SAMPLE_PACKAGE], &["--no-deps"], remedy)?;
    find(&environment, Path::new("jikudata/datasets/SpeedPP2DS")).with_context(|| {
        format!("{SAMPLE_PACKAGE} lacks its data set: remove {} and run the command again", environment.display())
    })
}

/// Creates the private Python environment with the tools for the Python package, if it is missing or has other packages. Returns
/// its folder.
pub fn package() -> Result<PathBuf> {
    let remedy = "the tools for the Python package come from PyPI: check the network connection";
    environment_of("package", &PACKAGE_TOOLS, &[], remedy)
}

/// Creates the private Python environment with [`FORMAT_READERS`], if it is missing or has other packages. Returns its
/// interpreter.
pub fn formats() -> Result<PathBuf> {
    let remedy =
        "the readers of exported files come from PyPI and need Python 3.11 or newer: check the network connection";
    Ok(program(&environment_of("formats", &FORMAT_READERS, &["--no-deps"], remedy)?, "python"))
}

/// Creates the private Python environment with [`MANAGEMENT_CLIENT`], if it is missing or has other packages. Returns its
/// interpreter.
pub fn management() -> Result<PathBuf> {
    let remedy = "smpclient comes from PyPI: check the network connection";
    Ok(program(&environment_of("management", &MANAGEMENT_CLIENT, &[], remedy)?, "python"))
}

/// Creates the private Python environment `name` with these packages, if it is missing or has other packages. Returns its folder.
/// `options` are those of `pip install`; `remedy` is reported if the installation fails.
fn environment_of(name: &str, packages: &[&str], options: &[&str], remedy: &'static str) -> Result<PathBuf> {
    let environment = cache().join(name);
    environment_with(&environment, &packages.join(" "), || {
        pip(&environment, &[&["install"], options, packages].concat()).context(remedy)
    })?;
    Ok(environment)
}

/// Creates a Python environment in this folder, unless it is complete and has the same list of packages. `fill` installs the
/// packages with [`pip`].
fn environment_with(environment: &Path, packages: &str, fill: impl FnOnce() -> Result<()>) -> Result<()> {
    let _installation = installation();
    std::fs::create_dir_all(cache())?;
    if !pip_program().is_file() {
        create_environment(&cache().join(PIP), &[])?;
    }
    let stamp = environment.join(PYTHON_STAMP);
    if std::fs::read_to_string(&stamp).ok().as_deref() != Some(packages) {
        create_environment(environment, &["--without-pip"])?;
        fill()?;
        std::fs::write(&stamp, packages)?;
    }
    Ok(())
}

/// The path of a program in an environment.
pub fn program(environment: &Path, name: &str) -> PathBuf {
    environment.join(if cfg!(windows) { "Scripts" } else { "bin" }).join(name)
}

/// The name of the private Python environment with the pip that fills all others: an environment without pip is created much
/// faster.
const PIP: &str = "pip";

/// The path of pip.
fn pip_program() -> PathBuf {
    program(&cache().join(PIP), if cfg!(windows) { "pip.exe" } else { "pip" })
}

/// Runs pip for an environment that [`environment_with`] has created.
pub fn pip(environment: &Path, options: &[&str]) -> Result<()> {
    let mut command = Command::new(pip_program());
    command.arg("--python").arg(program(environment, "python"));
    command.args(["--disable-pip-version-check", "--quiet"]).args(options);
    if options.first() == Some(&"install") {
        // Most modules are never imported, so they are not compiled beforehand.
        command.arg("--no-compile");
    }
    run_command(&mut command)
}

/// Creates a new, empty environment in this folder with these options of the Python module venv. The caller holds
/// [`INSTALLATION`].
fn create_environment(environment: &Path, options: &[&str]) -> Result<()> {
    let path = environment.to_string_lossy();
    let create = [&["-m", "venv", "--clear"], options, &[&path]].concat();
    if run("python3", &create).is_ok() {
        return Ok(());
    }
    // Debian has the module venv in a separate package.
    install_now(&OsPackage {
        title: "Python 3 with venv",
        apt: "python3-venv",
        dnf: "python3",
        pacman: "python",
        brew: "python",
    })?;
    run("python3", &create)
}

/// Finds the folder with the path `below` in the environment's installed packages.
fn find(environment: &Path, below: &Path) -> Option<PathBuf> {
    let versions = std::fs::read_dir(environment.join("lib")).ok()?.flatten().map(|folder| folder.path());
    // On Windows, the path of the packages does not contain the version of Python.
    let mut libraries = versions.chain([environment.join("Lib")]);
    libraries.find_map(|library| Some(library.join("site-packages").join(below)).filter(|path| path.is_dir()))
}

/// A package of the operating system: its title for messages, and its name for each package manager.
struct OsPackage {
    title: &'static str,
    apt: &'static str,
    dnf: &'static str,
    pacman: &'static str,
    brew: &'static str,
}

/// Installs a package as soon as no other thread installs anything, like [`install_now`].
fn install(package: &OsPackage) -> Result<()> {
    let _installation = installation();
    install_now(package)
}

/// Installs a package with the system's package manager, through sudo unless the user is root. Homebrew needs no sudo. The caller
/// holds [`INSTALLATION`].
fn install_now(package: &OsPackage) -> Result<()> {
    let managers: [(&str, &[&str], &str); 4] = [
        // QEMU and Chromium recommend 200 packages, such as printer drivers, that nothing here uses.
        ("apt-get", &["install", "--yes", "--no-install-recommends"], package.apt),
        ("dnf", &["install", "--assumeyes"], package.dnf),
        ("pacman", &["--sync", "--noconfirm"], package.pacman),
        ("brew", &["install"], package.brew),
    ];
    let Some((manager, arguments, name)) = managers.into_iter().find(|(manager, ..)| has(manager)) else {
        bail!("{} is missing, and no supported package manager was found: install it by hand", package.title);
    };
    eprintln!("{} is missing: installing {name}", package.title);
    let by_hand = format!("install it by hand: {manager} {} {name}", arguments.join(" "));
    let is_root = Command::new("id").arg("-u").output().is_ok_and(|id| id.stdout.trim_ascii() == b"0");
    let words = |arguments: &[&'static str]| {
        let sudo = (manager != "brew" && !is_root).then_some("sudo");
        sudo.into_iter().chain([manager]).chain(arguments.iter().copied()).collect::<Vec<_>>()
    };
    if manager == "apt-get" {
        let update = words(&["update"]);
        run(update[0], &update[1..]).with_context(|| by_hand.clone())?;
    }
    let names: Vec<_> = name.split(' ').collect();
    let install = words(&[arguments, &names].concat());
    run(install[0], &install[1..]).with_context(|| by_hand)
}
