//! `cargo +nightly fuzz run --features libfuzzer panorama`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    cairn_fuzz::Target::Panorama.run(data);
});
