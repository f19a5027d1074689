//! Sets the environment variable `PLANTAR_VERSION` for the compilation: the version of the package and, if it is known, the
//! commit.

fn main() {
    build_support::version();
}
