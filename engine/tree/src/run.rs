//! Ticking against the wall clock.

use crate::status::Status;
use crate::tree::Tree;
use std::time::{Duration, Instant};

impl<C> Tree<C> {
    /// Ticks until the tree has ended, once a period, and at once when a node wakes the tree or asks for another tick.
    ///
    /// Time is the wall clock from the call on. Where time is simulated, call [`Tree::tick`] instead.
    pub fn run(&mut self, period: Duration, context: &mut C) -> Status {
        let waker = self.waker();
        let begun = Instant::now();
        // Time goes on where an earlier run ended.
        let offset_secs = self.now_secs();
        loop {
            let tick_begun = Instant::now();
            let status = self.tick(offset_secs + begun.elapsed().as_secs_f64(), context);
            if status != Status::Running {
                return status;
            }
            if !self.wants_tick() {
                let _woken = waker.wait(period.saturating_sub(tick_begun.elapsed()));
            }
        }
    }
}
