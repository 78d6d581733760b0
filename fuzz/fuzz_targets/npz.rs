#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| diaphane_fuzz::read("npz", bytes));
