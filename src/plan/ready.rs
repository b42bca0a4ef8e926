//! A plan that can be applied at any time, from any thread.

use std::sync::Mutex;

use crate::expansion::Expansion;
use crate::plan::{Plan, Workspace};

/// A plan and what its applications write to.
pub(crate) struct Ready<E: Expansion> {
    pub(crate) plan: Plan<E>,
    idle: Mutex<Vec<Workspace<E>>>,
}

impl<E: Expansion> Ready<E> {
    pub(crate) fn new(plan: Plan<E>) -> Self {
        Self { plan, idle: Mutex::new(Vec::new()) }
    }

    /// Lends a workspace that no other call is using: allocated once, then kept.
    pub(crate) fn with_workspace<V>(&self, work: impl FnOnce(&mut Workspace<E>) -> V) -> V {
        let idle = self.idle.lock().unwrap_or_else(|e| e.into_inner()).pop();
        let mut workspace = idle.unwrap_or_else(|| Workspace::new(&self.plan));
        let result = work(&mut workspace);
        self.idle.lock().unwrap_or_else(|e| e.into_inner()).push(workspace);
        result
    }
}
