//! Sets the environment variable `PLANTAR_VERSION` for the compiler: the version of the package and, in a git checkout, the
//! commit.

fn main() {
    build_support::version();
}
