//! `cargo +nightly fuzz run --features libfuzzer image`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    cairn_fuzz::Target::Image.run(data);
});
