//! Independent computations on all cores; with the feature `parallel` disabled, one after the other.

/// The values of `compute` for the indices from 0 to `count - 1`, in this order.
pub(crate) fn map<T: Send>(count: usize, compute: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        (0..count).into_par_iter().map(compute).collect()
    }
    #[cfg(not(feature = "parallel"))]
    (0..count).map(compute).collect()
}
