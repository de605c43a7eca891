//! Ends the program when it is asked to, leaving no half-made file.

/// Waits on a thread for Ctrl-C, SIGTERM and SIGHUP: temporary files go, and the exit code is 128 and the signal's
/// number, 130 for Ctrl-C. Elsewhere than on Unix the system ends the program as it always does, and the next bake
/// removes what is left.
#[cfg(unix)]
pub fn listen() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use signal_hook::iterator::Signals;

    // Without the handler the system's own stays: less tidy, and no reason not to bake.
    let Ok(mut signals) = Signals::new([SIGINT, SIGTERM, SIGHUP]) else {
        return;
    };
    let wait = move || {
        if let Some(signal) = signals.forever().next() {
            crate::temporary::remove_all_and_exit(128 + signal);
        }
    };
    let named = std::thread::Builder::new().name("signals".into());
    // The handler is gone with `signals` where the thread cannot be made.
    let _ = named.spawn(wait);
}

#[cfg(not(unix))]
pub fn listen() {}
