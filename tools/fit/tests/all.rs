//! All tests of this package in one program: each program of its own would have to be linked with the same libraries.

mod defects;
mod live;
mod prior;
mod rank;
mod reasons;
mod recorded;
mod sensitivity;
mod smooth;
mod truth;
