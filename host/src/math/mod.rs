//! Mathematics that no part of mechanics owns.

pub mod least_squares;
