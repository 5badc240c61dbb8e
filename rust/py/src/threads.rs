//! The thread pool that the core runs in, and long computations that Python watches.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often Ctrl-C is looked for while nothing is reported.
const POLL: Duration = Duration::from_millis(50);

struct Pools {
    /// Threads wanted; 0 for one a core.
    threads: usize,
    /// The pool and the process that made it.
    current: Option<(u32, Arc<ThreadPool>)>,
}

static POOLS: Mutex<Pools> = Mutex::new(Pools { threads: 0, current: None });

/// This process's pool. A forked child has none of its parent's threads and would wait for them forever, so it
/// makes a pool of its own.
fn pool() -> PyResult<Arc<ThreadPool>> {
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some((owner, pool)) = &pools.current
        && *owner == process
    {
        return Ok(pool.clone());
    }
    let pool = ThreadPoolBuilder::new().num_threads(pools.threads).build();
    let pool = Arc::new(pool.map_err(|e| PyRuntimeError::new_err(format!("no threads to run in: {e}")))?);
    if let Some(parents) = pools.current.replace((process, pool.clone())) {
        // Its threads cannot be told to end: they live in the parent.
        std::mem::forget(parents);
    }
    Ok(pool)
}

/// Limit the core to `n` threads from now on. Results do not depend on it.
#[pyfunction]
pub fn set_threads(n: usize) {
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    pools.threads = n;
    pools.current = None;
}

/// Run `work` in the pool, detached from the interpreter.
pub fn run<R: Send>(py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
    let pool = pool()?;
    Ok(py.detach(|| pool.install(work)))
}

/// Run `work` in the pool while the calling thread answers its reports and Ctrl-C, which only it can see.
///
/// `work` gets a function that reports an event and says whether to go on; `seen` handles an event in Python. An error
/// of either ends the work at its next report and is returned.
pub fn run_watched<E: Send, R: Send>(
    py: Python<'_>,
    work: impl FnOnce(&mut dyn FnMut(E) -> bool) -> R + Send,
    mut seen: impl FnMut(Python<'_>, E) -> PyResult<()> + Send,
) -> PyResult<R> {
    let pool = pool()?;
    let (report, reports) = channel();
    let (answer, answers) = channel();
    py.detach(move || {
        std::thread::scope(move |scope| {
            let worker = scope.spawn(move || {
                pool.install(move || {
                    work(&mut |event| report.send(event).is_ok() && answers.recv().unwrap_or(false))
                })
            });
            let mut outcome = Ok(());
            loop {
                let event = match reports.recv_timeout(POLL) {
                    Ok(event) => Some(event),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                let reported = event.is_some();
                if outcome.is_ok() {
                    outcome = Python::attach(|py| {
                        py.check_signals()?;
                        event.map_or(Ok(()), |event| seen(py, event))
                    });
                }
                if reported && answer.send(outcome.is_ok()).is_err() {
                    break;
                }
            }
            match worker.join() {
                Ok(result) => outcome.map(|()| result),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        })
    })
}
