//! SIGINT and SIGTERM: the first asks to stop, the second ends the process.

use tokio_util::sync::CancellationToken;

use super::exit::Exit;

/// The first SIGINT or SIGTERM cancels `cancel`, keeping what is finished; the second ends the process.
pub async fn stop_on_signals(cancel: CancellationToken) {
    let mut signals = Signals::listen();
    signals.next().await;
    tracing::warn!("stopping: what is finished is kept; once more to stop at once");
    cancel.cancel();
    signals.next().await;
    std::process::exit(i32::from(Exit::Interrupted.code()));
}

#[cfg(unix)]
struct Signals(Vec<tokio::signal::unix::Signal>);

#[cfg(unix)]
impl Signals {
    /// Listens from now on; a signal that cannot be listened to ends the process, and the store survives that too.
    fn listen() -> Self {
        use tokio::signal::unix::{SignalKind, signal};
        let kinds = [SignalKind::interrupt(), SignalKind::terminate()];
        Self(kinds.into_iter().filter_map(|kind| signal(kind).ok()).collect())
    }

    async fn next(&mut self) {
        std::future::poll_fn(|context| {
            let heard = self.0.iter_mut().any(|signal| signal.poll_recv(context).is_ready());
            if heard { std::task::Poll::Ready(()) } else { std::task::Poll::Pending }
        })
        .await;
    }
}

#[cfg(not(unix))]
struct Signals;

#[cfg(not(unix))]
impl Signals {
    fn listen() -> Self {
        Self
    }

    async fn next(&mut self) {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}
