//! Things that are kept for the next call instead of being allocated again.

use std::sync::Mutex;

/// Values that no call is using at the moment.
#[derive(Debug)]
pub(crate) struct Pool<V> {
    /// Boxed, so that taking one and putting it back moves no more than a pointer.
    idle: Mutex<Vec<Box<V>>>,
}

impl<V> Default for Pool<V> {
    fn default() -> Self {
        Self { idle: Mutex::new(Vec::new()) }
    }
}

impl<V> Pool<V> {
    /// Calls `use_it` with a value that no other call is using; `make` makes one if there is none.
    pub(crate) fn with<R>(&self, make: impl FnOnce() -> V, use_it: impl FnOnce(&mut V) -> R) -> R {
        let idle = self.idle.lock().unwrap_or_else(|e| e.into_inner()).pop();
        let mut value = idle.unwrap_or_else(|| Box::new(make()));
        let result = use_it(&mut value);
        self.idle.lock().unwrap_or_else(|e| e.into_inner()).push(value);
        result
    }
}
