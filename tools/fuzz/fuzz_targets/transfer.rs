#![no_main]

#[path = "../../../tests/fuzz_corpus/readers.rs"]
mod readers;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| readers::transfer(bytes));
