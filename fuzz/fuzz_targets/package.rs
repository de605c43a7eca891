//! `cargo +nightly fuzz run --features libfuzzer package`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    cairn_fuzz::Target::Package.run(data);
});
