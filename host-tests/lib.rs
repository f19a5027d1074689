//! This library is empty: the package has tests only.
