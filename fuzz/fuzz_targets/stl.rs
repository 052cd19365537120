//! Whatever the bytes of a file called `.stl` are, they are a mesh or an error.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| chladni_fuzz::read("nowhere/fuzz.stl", bytes));
