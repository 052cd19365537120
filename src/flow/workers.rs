//! A fixed set of threads for CPU-bound work, fed through a bounded crossbeam channel.
//!
//! The async side takes a permit before it sends, so that sending never blocks a thread of the runtime.

use std::any::Any;
use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;

use crossbeam::channel::{Sender, bounded};
use tokio::sync::{Semaphore, oneshot};

type Task = Box<dyn FnOnce() + Send>;

/// The worker threads. Dropping it ends them after the work they have.
pub struct Workers {
    tasks: Option<Sender<Task>>,
    slots: Arc<Semaphore>,
    threads: Vec<JoinHandle<()>>,
}

/// Work that panicked, with its message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("internal error: {message}")]
pub struct Panicked {
    /// What the panic said.
    pub message: String,
}

impl Workers {
    /// Starts `count` threads.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start(count: NonZeroUsize) -> std::io::Result<Self> {
        // Permits are held until the work is done, so that a task is sent only when a worker is free for it.
        let (tasks, inbox) = bounded::<Task>(count.get());
        let threads = (0..count.get())
            .map(|i| {
                let inbox = inbox.clone();
                std::thread::Builder::new()
                    .name(format!("worker-{i}"))
                    .spawn(move || inbox.iter().for_each(|task| task()))
            })
            .collect::<std::io::Result<_>>()?;
        Ok(Self { tasks: Some(tasks), slots: Arc::new(Semaphore::new(count.get())), threads })
    }

    /// Runs `work` on a worker and waits for it without blocking. A panic in it is caught.
    ///
    /// # Errors
    /// [`Panicked`].
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Panicked> {
        let gone = |_| Panicked { message: "the worker threads have ended".into() };
        let slot = self.slots.clone().acquire_owned().await.map_err(|_| gone(()))?;
        let (reply, answer) = oneshot::channel();
        let span = tracing::Span::current();
        let task: Task = Box::new(move || {
            let result = span.in_scope(|| contained(work));
            drop(slot);
            // Nobody waits any more when the run was abandoned; the result is dropped then.
            let _ = reply.send(result);
        });
        self.tasks
            .as_ref()
            .ok_or(())
            .and_then(|tasks| tasks.send(task).map_err(|_| ()))
            .map_err(gone)?;
        answer.await.map_err(|_| gone(()))?
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        self.tasks = None;
        for thread in self.threads.drain(..) {
            // Tasks catch their panics; there is nothing to learn from the thread itself.
            let _ = thread.join();
        }
    }
}

/// Does `work`. A panic in it is caught.
///
/// # Errors
/// [`Panicked`].
pub fn contained<T>(work: impl FnOnce() -> T) -> Result<T, Panicked> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| Panicked { message: message_of(&*panic) })
}

fn message_of(panic: &(dyn Any + Send)) -> String {
    panic
        .downcast_ref::<&str>()
        .map(ToString::to_string)
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without a message".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn work_runs_on_the_workers_and_panics_stay_there() {
        let workers = Workers::start(NonZeroUsize::MIN).unwrap();
        let name = workers.run(|| std::thread::current().name().map(String::from)).await;
        assert_eq!(name, Ok(Some("worker-0".into())));
        let panicked = workers.run(|| -> () { panic!("no {}", "luck") }).await;
        assert_eq!(panicked, Err(Panicked { message: "no luck".into() }));
        assert_eq!(workers.run(|| 7).await, Ok(7));
    }
}
