//! Comparisons: the program against answers known in advance, against textbook schemes, and against itself at other targets.

pub mod figure3;
pub mod known;
pub mod ladder;
pub mod stability;
pub mod textbook;
