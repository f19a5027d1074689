//! Rebuilds the tests when a scenario is added or removed, because each file becomes a test; sets the version that the firmware
//! reports.

fn main() {
    println!("cargo:rerun-if-changed=scenarios");
    build_support::version();
}
