//! Rebuilds the tests after a scenario was added or removed, because each file becomes a test. Sets the environment variable with
//! the version that the firmware reports.

fn main() {
    println!("cargo:rerun-if-changed=scenarios");
    build_support::version();
}
