//! Integration tests.

mod wct_file;
