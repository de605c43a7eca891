//! `cargo +nightly fuzz run --features libfuzzer gltf`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    cairn_fuzz::Target::Gltf.run(data);
});
