//! The threads that the core runs in, and long computations that Python watches.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use std::cell::OnceCell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often Ctrl-C is looked for while nothing is reported.
const POLL: Duration = Duration::from_millis(50);

struct Pools {
    /// Threads wanted; 0 for one a core.
    threads: usize,
    /// The pool and the process that made it.
    current: Option<(u32, Arc<ThreadPool>)>,
}

static POOLS: Mutex<Pools> = Mutex::new(Pools { threads: 0, current: None });

thread_local! {
    /// A pool of the calling thread alone: waking another one takes as long as the work on a small model.
    static ALONE: OnceCell<Result<ThreadPool, ThreadPoolBuildError>> = const { OnceCell::new() };
}

fn no_threads(error: &ThreadPoolBuildError) -> PyErr {
    PyRuntimeError::new_err(format!("no threads to run in: {error}"))
}

/// This process's pool, none where the calling thread shall work alone. A forked child has none of its parent's threads
/// and would wait for them forever, so it makes a pool of its own.
fn pool() -> PyResult<Option<Arc<ThreadPool>>> {
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    if pools.threads == 1 {
        return Ok(None);
    }
    let process = std::process::id();
    if let Some((owner, pool)) = &pools.current
        && *owner == process
    {
        return Ok(Some(pool.clone()));
    }
    let pool = ThreadPoolBuilder::new().num_threads(pools.threads).build();
    let pool = Arc::new(pool.map_err(|e| no_threads(&e))?);
    if let Some(parents) = pools.current.replace((process, pool.clone())) {
        // Its threads cannot be told to end: they live in the parent.
        std::mem::forget(parents);
    }
    Ok(Some(pool))
}

/// Limit every call of the core to `n` threads from now on, 1 being the calling one. Results do not depend on it.
#[pyfunction]
pub fn set_threads(n: usize) {
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    pools.threads = n;
    pools.current = None;
}

fn alone<R: Send>(work: impl FnOnce() -> R + Send) -> PyResult<R> {
    ALONE.with(|own| {
        let build = || ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
        own.get_or_init(build).as_ref().map_err(no_threads).map(|pool| pool.install(work))
    })
}

/// Run `work` in the pool, detached from the interpreter.
pub fn run<R: Send>(py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
    match pool()? {
        Some(pool) => Ok(py.detach(|| pool.install(work))),
        None => py.detach(|| alone(work)),
    }
}

/// When a computation has to end.
#[derive(Clone, Copy)]
pub struct Deadline(Option<Instant>);

impl Deadline {
    /// So many seconds from now; never without a number, or with one beyond what a clock counts.
    pub fn after(seconds: Option<f64>) -> Self {
        let left = seconds.and_then(|s| Duration::try_from_secs_f64(s.max(0.0)).ok());
        Self(left.and_then(|left| Instant::now().checked_add(left)))
    }

    /// Whether it is over.
    pub fn passed(self) -> bool {
        self.0.is_some_and(|end| Instant::now() >= end)
    }
}

/// For work whose reports nobody sees.
pub const UNSEEN: Option<fn(Python<'_>, ()) -> PyResult<()>> = None;

/// Run `work` in the pool while the calling thread answers its reports and Ctrl-C, which only it can see.
///
/// `work` gets a function that reports an event and says whether to go on; `seen` handles an event in Python. An error
/// of either ends the work at its next report and is returned.
pub fn run_watched<E: Send, R: Send>(
    py: Python<'_>,
    work: impl FnOnce(&mut dyn FnMut(E) -> bool) -> R + Send,
    mut seen: Option<impl FnMut(Python<'_>, E) -> PyResult<()> + Send>,
) -> PyResult<R> {
    let silent = seen.is_none();
    let mut look = move |event: Option<E>| {
        Python::attach(|py| {
            py.check_signals()?;
            if let (Some(seen), Some(event)) = (&mut seen, event) { seen(py, event) } else { Ok(()) }
        })
    };
    let Some(pool) = pool()? else {
        return py.detach(move || {
            let (mut outcome, mut looked) = (Ok(()), Instant::now());
            let result = alone(|| {
                work(&mut |event| {
                    if outcome.is_ok() && (!silent || looked.elapsed() >= POLL) {
                        (outcome, looked) = (look(Some(event)), Instant::now());
                    }
                    outcome.is_ok()
                })
            })?;
            outcome.map(|()| result)
        });
    };
    py.detach(move || {
        let ((report, reports), (answer, answers)) = (channel(), channel());
        let (mut result, stop) = (None, AtomicBool::new(false));
        let (found, stopped) = (&mut result, &stop);
        let outcome = pool.in_place_scope(move |scope| {
            scope.spawn(move |_| {
                *found = Some(work(&mut |event| {
                    if silent {
                        !stopped.load(Ordering::Relaxed)
                    } else {
                        report.send(event).is_ok() && answers.recv().unwrap_or(false)
                    }
                }));
                // All that is reported is over when this end of the channel is gone.
                drop(report);
            });
            let mut outcome = Ok(());
            loop {
                let event = match reports.recv_timeout(POLL) {
                    Ok(event) => Some(event),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => return outcome,
                };
                let reported = event.is_some();
                if outcome.is_ok() {
                    outcome = look(event);
                }
                stopped.store(outcome.is_err(), Ordering::Relaxed);
                if reported && answer.send(outcome.is_ok()).is_err() {
                    return outcome;
                }
            }
        });
        // A panic of the work has gone on from the scope.
        outcome.map(|()| result.expect("the work is done"))
    })
}
