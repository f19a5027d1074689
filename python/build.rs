//! Sets the variable `PLANTAR_VERSION`: the version of the package and the commit.

fn main() {
    build_support::version();
}
