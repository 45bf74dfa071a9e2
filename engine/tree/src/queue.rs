//! A queue that nodes share.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Items that some nodes append and a `loop` takes, first come first served. Clones share the items.
#[derive(Debug)]
pub struct Queue<T>(Arc<Mutex<VecDeque<T>>>);

impl<T> Clone for Queue<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T> Default for Queue<T> {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(VecDeque::new())))
    }
}

impl<T> Queue<T> {
    /// Appends an item.
    pub fn push(&self, item: T) {
        self.items().push_back(item);
    }

    /// Takes the first item.
    #[must_use]
    pub fn pop(&self) -> Option<T> {
        self.items().pop_front()
    }

    /// How many items wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.items().len()
    }

    /// Whether none waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.items().is_empty()
    }

    fn items(&self) -> std::sync::MutexGuard<'_, VecDeque<T>> {
        // A panic elsewhere cannot leave half an item.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T> FromIterator<T> for Queue<T> {
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> Self {
        Self(Arc::new(Mutex::new(items.into_iter().collect())))
    }
}
