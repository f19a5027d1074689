//! Signals that end a session as the key q does, so that files are completed: SIGINT, as from Ctrl-C if the
//! output is not a terminal (on the display, Ctrl-C is a key), and SIGTERM.

#[cfg(unix)]
use signal_hook::consts::{SIGINT, SIGTERM};
#[cfg(unix)]
use signal_hook::flag;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};

/// True if a signal has its default effect, which is to end the program at once. The first signal of a session sets it.
static HAS_DEFAULT_EFFECT: LazyLock<Arc<AtomicBool>> = LazyLock::new(|| {
    let has_default_effect = Arc::new(AtomicBool::new(true));
    #[cfg(unix)]
    for signal in [SIGINT, SIGTERM] {
        // The actions run in this order, so that the first signal only sets the value. If the first action cannot be registered,
        // the signal has its default effect. If only the second one could not, which is not expected, the signal would have none
        // in a session.
        let _ = flag::register_conditional_default(signal, has_default_effect.clone())
            .and_then(|_| flag::register(signal, has_default_effect.clone()));
    }
    has_default_effect
});

/// While it exists, the first signal does not end the program, but is reported by [`Signals::have_arrived`]; a second one ends
/// the program at once. At most one exists at a time.
pub struct Signals(());

impl Signals {
    /// Begins to catch signals.
    pub fn catch() -> Self {
        HAS_DEFAULT_EFFECT.store(false, Ordering::SeqCst);
        Self(())
    }

    /// True once a signal has arrived.
    pub fn have_arrived(&self) -> bool {
        HAS_DEFAULT_EFFECT.load(Ordering::SeqCst)
    }
}

impl Drop for Signals {
    fn drop(&mut self) {
        HAS_DEFAULT_EFFECT.store(true, Ordering::SeqCst);
    }
}
