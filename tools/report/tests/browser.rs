//! Opens and prints the report in Chromium. The browser is the program that the environment variable `PLANTAR_CHROMIUM` names, or
//! the one that is found in the folders of `PATH`.

mod common;

use common::{STUDY, TITLES};
use resvg::tiny_skia::Pixmap;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn browser() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("PLANTAR_CHROMIUM") {
        return Some(named.into());
    }
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| path.is_file())
}

/// Opens the report with a new profile.
fn open(browser: &Path, folder: &Path, arguments: &[&str]) -> Output {
    let profile = tempfile::tempdir().expect("a folder for the profile");
    let output = Command::new(browser)
        .current_dir(folder)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args(arguments)
        .arg(format!("file://{}", folder.join("report.html").display()))
        .output()
        .expect("the browser starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
#[ignore = "needs Chromium: cargo xtask test"]
fn a_browser_displays_and_prints_the_page() {
    let browser = browser().expect("Chromium is on the path, or PLANTAR_CHROMIUM names it");
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    std::fs::write(folder.join("report.html"), report::html(&STUDY)).expect("a page");

    let output = open(&browser, folder, &["--enable-logging=stderr", "--v=0", "--dump-dom"]);
    let dom = String::from_utf8_lossy(&output.stdout);
    assert!(dom.contains("<title>Plantar tissue of &lt;script&gt;"), "the title");
    for title in TITLES {
        assert!(dom.contains(&format!("<h3>{title}</h3>")), "{title}");
    }
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(!log.contains("CONSOLE"), "{log}");

    for size in ["1280,6000", "500,9000"] {
        open(&browser, folder, &["--hide-scrollbars", "--screenshot=report.png", &format!("--window-size={size}")]);
        let picture = Pixmap::load_png(folder.join("report.png")).expect("a screenshot");
        let colours: HashSet<_> = picture.pixels().iter().map(|p| (p.red(), p.green(), p.blue())).collect();
        assert!(colours.len() > 100, "{size}: {} colours", colours.len());
    }

    open(&browser, folder, &["--no-pdf-header-footer", "--print-to-pdf=report.pdf"]);
    let pdf = std::fs::read(folder.join("report.pdf")).expect("a PDF");
    let page = b"/Type /Page\n";
    let pages = pdf.windows(page.len()).filter(|window| window == page).count();
    assert!((2..=12).contains(&pages), "{pages} pages");
}
