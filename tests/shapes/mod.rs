//! Shapes and scenes made in code, as the stability suite of the library has them.

#![allow(unused_imports)] // Each integration test takes the shapes that it needs.

pub use glowtree::compare::known::*;
