//! `cargo +nightly fuzz run --features libfuzzer glb`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    cairn_fuzz::Target::Glb.run(data);
});
