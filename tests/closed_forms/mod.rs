//! Answers known in closed form, as the stability suite of the library has them.

#![allow(unused_imports)] // Each integration test takes the answers that it needs.

pub use glowtree::compare::known::answers::*;
