//! All integration tests of this package in one program: each program of its own would have to be linked with the same
//! libraries.

// The workspace enables this feature; with `cargo test -p fit` alone, these tests need `--features results`.
#[cfg(feature = "results")]
mod defects;
mod effective_area;
mod live;
mod prior;
mod rank;
mod reasons;
mod recorded;
mod references;
mod sensitivity;
mod smooth;
mod truth;
