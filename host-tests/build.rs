//! Rebuilds the tests after a scenario was added or removed, because each file in `scenarios` becomes a test. Sets the
//! environment variable `PLANTAR_VERSION`, which contains the version that the firmware reports.

fn main() {
    println!("cargo:rerun-if-changed=scenarios");
    build_support::version();
}
