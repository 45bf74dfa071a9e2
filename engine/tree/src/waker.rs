//! Wakes the owner of a tree before its period is over.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// Ends a wait for the next tick, from any thread. Clones wake the same tree.
#[derive(Clone, Debug, Default)]
pub struct Waker(Arc<Signal>);

#[derive(Debug, Default)]
struct Signal {
    is_set: Mutex<bool>,
    changed: Condvar,
}

impl Waker {
    /// Ends the wait that goes on, or the next one.
    pub fn wake(&self) {
        *self.0.is_set.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.changed.notify_all();
    }

    /// Waits until somebody wakes or the time is over; whether somebody did.
    #[must_use]
    pub fn wait(&self, at_most: Duration) -> bool {
        let is_set = self.0.is_set.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.0.changed.wait_timeout_while(is_set, at_most, |is_set| !*is_set);
        let (mut is_set, _timeout) = waited.unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut *is_set)
    }
}
