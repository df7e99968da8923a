//! Comparisons: the program against answers known in advance, against textbook schemes, and against itself at other targets.

pub mod known;
pub mod stability;
pub mod textbook;
