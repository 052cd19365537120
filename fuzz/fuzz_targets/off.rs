//! Whatever the bytes of a file called `.off` are, they are a mesh or an error.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = chladni::mesh::load_bytes("nowhere/fuzz.off".as_ref(), bytes);
});
