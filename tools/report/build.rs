//! Sets the environment variable `PLANTAR_VERSION` for the compiler: the version of the package and the commit.

fn main() {
    build_support::version();
}
