//! Work on every processor.
//!
//! The library of searches knows no threads: whoever calls it does its work ([`Caller`]), and here is who. Each thread takes the
//! next task when it is done with one, so that none waits for a long one. What is found is the same as by one thread.
//!
//! Errors: none; a task that panics does so in whoever waits for it.

use std::num::NonZeroUsize;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::thread;

use palpate::{Caller, never};

/// Who waits for a search to its end.
pub(crate) const PATIENT: EveryProcessor<fn() -> bool> = EveryProcessor { stops: never };

/// Works on every processor until it is told to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EveryProcessor<F> {
    pub(crate) stops: F,
}

impl<F: Fn() -> bool + Sync> Caller for EveryProcessor<F> {
    fn stops(&self) -> bool {
        (self.stops)()
    }

    fn work(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        shared(count, processors(), task);
    }
}

/// As many threads as may run at once; one where the system does not say.
pub(crate) fn processors() -> NonZeroUsize {
    thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

/// Does the tasks from 0 to `count`, each once, on so many threads, this one among them.
pub(crate) fn shared(count: usize, threads: NonZeroUsize, task: impl Fn(usize) + Sync) {
    let next = AtomicUsize::new(0);
    let work = || {
        let numbers = std::iter::repeat_with(|| next.fetch_add(1, Relaxed));
        numbers.take_while(|number| *number < count).for_each(&task);
    };
    thread::scope(|scope| {
        for _ in 1..threads.get().min(count) {
            // Where the system has no more threads, fewer do it.
            let _ = thread::Builder::new().name("palpate work".to_owned()).spawn_scoped(scope, work);
        }
        work();
    });
}

/// What comes of each number from 0 to `count`, in order, on every processor.
pub(crate) fn of_each<T: Send>(count: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let made = Mutex::new((0..count).map(|_| None).collect::<Vec<_>>());
    shared(count, processors(), |number| {
        let it = of(number);
        if let Ok(mut made) = made.lock() {
            made[number] = Some(it);
        }
    });
    made.into_inner().unwrap_or_default().into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_task_is_done_once_whatever_the_threads() {
        for (count, threads) in [(0, 1), (1, 4), (7, 1), (100, 4), (3, 16)] {
            let done = Mutex::new(vec![0; count]);
            shared(count, NonZeroUsize::new(threads).unwrap(), |task| done.lock().unwrap()[task] += 1);
            assert_eq!(done.into_inner().unwrap(), vec![1; count], "{threads} threads");
        }
        assert_eq!(of_each(50, |number| number * number), (0..50).map(|number| number * number).collect::<Vec<_>>());
    }
}
