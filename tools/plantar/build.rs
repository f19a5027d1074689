//! Sets the version of the build.

fn main() {
    build_support::version();
}
