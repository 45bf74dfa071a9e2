//! Actions whose work runs in a thread of its own.

use crate::action::{Action, Halt, Tick};
use crate::port::PortSpec;
use crate::registry::{NodeModel, Registry};
use crate::status::{Failure, Outcome, Progress, reason};
use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// Time that work is given to notice that it is not wanted any more.
const STOP_WITHIN_SECS: f64 = 1.0;

/// Tells the work of a threaded action that it is not wanted any more. Work that takes long looks at it often.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Whether the work should end.
    #[must_use]
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}

struct Work<R> {
    result: Receiver<R>,
    stop: Stop,
}

impl<R> Drop for Work<R> {
    fn drop(&mut self) {
        self.stop.0.store(true, Ordering::Release);
    }
}

struct Threaded<B, F, R> {
    name: String,
    begin: Arc<B>,
    finish: Arc<F>,
    work: Option<Work<R>>,
}

impl<C, B, F, J, R> Action<C> for Threaded<B, F, R>
where
    B: Fn(&mut Tick<'_, C>) -> Result<J, Failure> + Send + Sync + 'static,
    F: Fn(&mut Tick<'_, C>, R) -> Outcome + Send + Sync + 'static,
    J: FnOnce(&Stop) -> R + Send + 'static,
    R: Send + 'static,
{
    fn start(&mut self, tick: &mut Tick<'_, C>) -> Outcome {
        let work = (self.begin)(tick)?;
        let (stop, waker, (sender, result)) = (Stop::default(), tick.waker(), channel());
        let stop_of_work = stop.clone();
        let spawned = std::thread::Builder::new().name(self.name.clone()).spawn(move || {
            // Dropped before the waker wakes, also by a panic, so that the owner finds the end of the work.
            let wake_at_end = WakeAtEnd(waker);
            let result = work(&stop_of_work);
            // Nobody listens when the tree was dropped.
            drop(sender.send(result));
            drop(sender);
            drop(wake_at_end);
        });
        match spawned {
            Ok(_detached) => {
                self.work = Some(Work { result, stop });
                Ok(Progress::Running)
            }
            Err(error) => Err(Failure::new(reason::NO_THREAD, error.to_string())),
        }
    }

    fn poll(&mut self, tick: &mut Tick<'_, C>) -> Outcome {
        let received = self.work.as_ref().map_or(Err(TryRecvError::Disconnected), |work| work.result.try_recv());
        match received {
            Ok(result) => {
                self.work = None;
                (self.finish)(tick, result)
            }
            Err(TryRecvError::Empty) => Ok(Progress::Running),
            Err(TryRecvError::Disconnected) => {
                self.work = None;
                Err(Failure::new(reason::PANICKED, "in its thread"))
            }
        }
    }

    fn halt(&mut self, _tick: &mut Tick<'_, C>) -> Halt {
        let Some(work) = &self.work else { return Halt::Done };
        work.stop.0.store(true, Ordering::Release);
        if matches!(work.result.try_recv(), Err(TryRecvError::Empty)) {
            return Halt::Pending { within_secs: STOP_WITHIN_SECS };
        }
        self.work = None;
        Halt::Done
    }
}

struct WakeAtEnd(crate::waker::Waker);

impl Drop for WakeAtEnd {
    fn drop(&mut self) {
        self.0.wake();
    }
}

impl<C: 'static> Registry<C> {
    /// Adds an action that works in a thread: `begin` reads ports and gives the work, the work runs beside the ticks, and
    /// `finish` gets its result in the tick after its end, which the thread brings about at once through the tree's waker.
    ///
    /// A halt sets the work's [`Stop`] and waits, over several ticks, until it has ended. A panic of the work is a failure
    /// with reason [`crate::reason::PANICKED`].
    ///
    /// # Panics
    /// If the name is taken or a default does not fit its port.
    pub fn threaded<J, R>(
        &mut self,
        name: impl Into<Cow<'static, str>>,
        ports: impl IntoIterator<Item = PortSpec>,
        begin: impl Fn(&mut Tick<'_, C>) -> Result<J, Failure> + Send + Sync + 'static,
        finish: impl Fn(&mut Tick<'_, C>, R) -> Outcome + Send + Sync + 'static,
    ) -> &mut NodeModel
    where
        J: FnOnce(&Stop) -> R + Send + 'static,
        R: Send + 'static,
    {
        let name = name.into();
        let (begin, finish, thread_name) = (Arc::new(begin), Arc::new(finish), name.to_string());
        self.action(name, ports, move || Threaded {
            name: thread_name.clone(),
            begin: Arc::clone(&begin),
            finish: Arc::clone(&finish),
            work: None,
        })
    }
}
