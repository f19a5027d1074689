//! Builds the tests again when a scenario is added or removed, as each file becomes a test.

fn main() {
    println!("cargo:rerun-if-changed=scenarios");
}
