//! Rates of the sites stage.
fn main() {}
