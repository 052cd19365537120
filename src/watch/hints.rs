//! When to look: when the system says that something has happened, and now and then.
//!
//! Whether the system says anything is found out with a cookie: a file that is made and removed in the folder, of which an
//! event has to come. In some containers none does. On network mounts one may, and yet no word of what other machines do:
//! these are known by their kind. In both cases the folder is looked at every second, which is said. A look is a scan of the
//! whole folder, so that watching by polling needs no watcher of its own.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use notify::event::{AccessKind, AccessMode};
use notify::{ErrorKind, EventKind, RecommendedWatcher, RecursiveMode};
use notify_debouncer_full::{DebounceEventResult, Debouncer, RecommendedCache, new_debouncer};
use tokio::sync::Notify;
use tokio::time::{Instant, sleep_until, timeout};

/// Events of so long a time are one hint.
const GATHERED: Duration = Duration::from_millis(40);

/// How long an event of the cookie is waited for.
const COOKIE: Duration = Duration::from_secs(2);

/// Looks without a hint, where the system gives hints: soon after one, since folders that are moved or made just then are not
/// listened to at once, and seldom when nothing has happened for long.
const SOON: Duration = Duration::from_millis(500);
const SELDOM: Duration = Duration::from_secs(30);

/// Where it gives none.
const POLLING: Duration = Duration::from_secs(1);

/// Hints of one folder.
pub struct Hints {
    folder: PathBuf,
    heard: Arc<Notify>,
    kind: Kind,
}

enum Kind {
    /// A look every so often.
    Polled(Duration),
    Native {
        watcher: Box<Debouncer<RecommendedWatcher, RecommendedCache>>,
        /// When the last hint came.
        last: Instant,
    },
}

/// Why a folder is polled.
#[derive(Debug, thiserror::Error)]
pub enum Silent {
    /// The system cannot watch more.
    #[error(
        "the system's limit of watched folders is reached; raise it with `sysctl fs.inotify.max_user_watches=1048576`"
    )]
    TooMany,
    /// It refuses.
    #[error("the system does not watch it: {0}")]
    Refused(notify::Error),
    /// It says nothing.
    #[error("the system says nothing of what happens there")]
    NoEvents,
    /// It says nothing of what others do.
    #[error("it is on {0}, where the system says nothing of what other machines do")]
    Shared(&'static str),
}

impl Hints {
    /// Listens to what happens below `folder`, and to the file `beside` it; not to what `counts` leaves out. Polls, and says
    /// why, where the system is silent.
    pub async fn of(
        folder: &Path,
        beside: Option<&Path>,
        counts: impl Fn(&Path) -> bool + Send + 'static,
    ) -> (Self, Option<Silent>) {
        if let Some(kind) = shared(folder) {
            return (Self::polling(folder, POLLING), Some(Silent::Shared(kind)));
        }
        match Self::native(folder, cookie_in(folder), beside, counts).await {
            Ok(hints) => (hints, None),
            Err(silent) => (Self::polling(folder, POLLING), Some(silent)),
        }
    }

    /// A look every so often, whatever the system says.
    pub fn polling(folder: &Path, every: Duration) -> Self {
        Self { folder: folder.into(), heard: Arc::default(), kind: Kind::Polled(every) }
    }

    /// Whether the system says when something happens.
    pub fn is_native(&self) -> bool {
        matches!(self.kind, Kind::Native { .. })
    }

    /// Waits for a hint, until the next look without one, where the last was at `looked`, or until one is `due`. Whether it was a
    /// hint.
    pub async fn next(
        &mut self,
        looked: std::time::Instant,
        due: Option<std::time::Instant>,
    ) -> bool {
        let looked = Instant::from(looked);
        let regular = looked
            + match &self.kind {
                Kind::Polled(every) => *every,
                Kind::Native { last, .. } => {
                    looked.saturating_duration_since(*last).clamp(SOON, SELDOM)
                }
            };
        let until = due.map_or(regular, |due| regular.min(due.into()));
        tokio::select! {
            () = self.heard.notified() => {
                if let Kind::Native { last, .. } = &mut self.kind {
                    *last = Instant::now();
                }
                true
            }
            () = sleep_until(until) => false,
        }
    }

    /// Something has happened that no hint has told of. Where none has come for a while it listens anew, since some folder is
    /// not listened to.
    pub fn missed_something(&mut self) {
        let Kind::Native { watcher, last } = &mut self.kind else { return };
        if last.elapsed() < SOON / 2 {
            return;
        }
        *last = Instant::now();
        // Where it is not listened to, there is nothing to end.
        let _ = watcher.unwatch(&self.folder);
        if let Err(error) = watcher.watch(&self.folder, RecursiveMode::Recursive) {
            tracing::warn!("{}: changes are seen late: {error}", self.folder.display());
        }
    }

    /// Listens, where a file that is made at `cookie` is heard of.
    async fn native(
        folder: &Path,
        cookie: PathBuf,
        beside: Option<&Path>,
        counts: impl Fn(&Path) -> bool + Send + 'static,
    ) -> Result<Self, Silent> {
        let (heard, found) = (Arc::new(Notify::new()), Arc::new(Notify::new()));
        let hint = heard.clone();
        let (seen, awaited) = (found.clone(), cookie.clone());
        let listen = move |events: DebounceEventResult| {
            // An error is a queue that overflowed, or a folder that is gone: a reason to look.
            let Ok(events) = events else { return hint.notify_one() };
            let happened = events.iter().filter(|event| !is_reading(event.kind));
            let mut paths = happened.flat_map(|event| match event.paths.as_slice() {
                // Nobody knows where: the folder has to be looked at.
                [] => vec![PathBuf::new()],
                paths => paths.to_vec(),
            });
            if events.iter().any(|event| event.paths.contains(&awaited)) {
                seen.notify_one();
            }
            if paths.any(|path| path != awaited && (path.as_os_str().is_empty() || counts(&path))) {
                hint.notify_one();
            }
        };
        let refused = |error: notify::Error| match error.kind {
            ErrorKind::MaxFilesWatch => Silent::TooMany,
            _ => Silent::Refused(error),
        };
        let mut watcher = new_debouncer(GATHERED, None, listen).map_err(refused)?;
        watcher.watch(folder, RecursiveMode::Recursive).map_err(refused)?;
        // Its folder, since a save may put another file in its place; where that cannot be watched, a look now and then does.
        // What is below the folder is listened to already, and would be anew, without what is below that.
        if let Some(around) =
            beside.and_then(Path::parent).filter(|around| !around.starts_with(folder))
            && let Err(error) = watcher.watch(around, RecursiveMode::NonRecursive)
        {
            tracing::debug!("{}: {error}", around.display());
        }
        // Where nothing can be written, the look now and then has to do.
        if std::fs::write(&cookie, "").is_ok() {
            let came = timeout(COOKIE, found.notified()).await.is_ok();
            let _ = std::fs::remove_file(&cookie);
            if !came {
                return Err(Silent::NoEvents);
            }
        }
        let kind = Kind::Native { watcher: Box::new(watcher), last: Instant::now() };
        Ok(Self { folder: folder.into(), heard, kind })
    }
}

/// Reading a file is an event too: our own.
fn is_reading(kind: EventKind) -> bool {
    match kind {
        EventKind::Access(AccessKind::Close(AccessMode::Write)) => false,
        EventKind::Access(_) => true,
        _ => false,
    }
}

/// What kind of file system a folder is on, if other machines may write to it.
#[cfg(target_os = "linux")]
fn shared(folder: &Path) -> Option<&'static str> {
    shared_kind(rustix::fs::statfs(folder).ok()?.f_type as u32)
}

#[cfg(not(target_os = "linux"))]
fn shared(_folder: &Path) -> Option<&'static str> {
    None
}

/// By the numbers of statfs(2), and the kernel's `magic.h`.
#[cfg(target_os = "linux")]
fn shared_kind(number: u32) -> Option<&'static str> {
    Some(match number {
        0x6969 => "an NFS mount",
        0x517B | 0xFF53_4D42 | 0xFE53_4D42 => "an SMB mount",
        0x0102_1997 => "a 9p mount",
        0x00C3_6400 => "a Ceph mount",
        0x5346_414F | 0x6B41_4653 => "an AFS mount",
        0x6573_5546 => "a FUSE mount",
        _ => return None,
    })
}

fn cookie_in(folder: &Path) -> PathBuf {
    folder.join(format!(".chladni-cookie-{}", std::process::id()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// Whether a hint comes within so many milliseconds.
    async fn comes(hints: &Hints, within: u64) -> bool {
        timeout(Duration::from_millis(within), hints.heard.notified()).await.is_ok()
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn writing_renaming_and_new_folders_are_hints_and_reading_and_what_does_not_count_are_none()
     {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().canonicalize().unwrap();
        fs::create_dir(folder.join("out")).unwrap();
        let out = folder.join("out");
        let (hints, silent) = Hints::of(&folder, None, move |path| !path.starts_with(&out)).await;
        if let Some(silent) = silent {
            eprintln!("skipped: {silent}");
            return;
        }
        assert!(hints.is_native());
        // The cookie's removal is no hint.
        assert!(!comes(&hints, 300).await);
        fs::write(folder.join("a.obj"), "v").unwrap();
        assert!(comes(&hints, 5000).await);
        while comes(&hints, 200).await {}
        fs::read(folder.join("a.obj")).unwrap();
        fs::write(folder.join("out/eigen.npz"), "x").unwrap();
        assert!(!comes(&hints, 300).await);
        fs::rename(folder.join("a.obj"), folder.join("b.obj")).unwrap();
        assert!(comes(&hints, 5000).await);
        while comes(&hints, 200).await {}
        fs::create_dir_all(folder.join("deep/er")).unwrap();
        fs::write(folder.join("deep/er/c.obj"), "v").unwrap();
        assert!(comes(&hints, 5000).await);
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn without_hints_there_is_a_look_now_and_then_and_when_one_is_due() {
        let mut hints = Hints::polling(Path::new("here"), Duration::from_millis(50));
        let began = std::time::Instant::now();
        hints.next(began, None).await;
        assert!(began.elapsed() >= Duration::from_millis(45));
        let mut slow = Hints::polling(Path::new("here"), Duration::from_secs(60));
        slow.next(began, Some(began)).await;
        assert!(began.elapsed() < Duration::from_secs(30));
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn a_system_that_says_nothing_is_found_out() {
        // A cookie of which no event can come, since nobody listens there.
        let [dir, elsewhere] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let cookie = elsewhere.path().join("cookie");
        let heard = Hints::native(dir.path(), cookie.clone(), None, |_| true).await;
        assert!(matches!(heard, Err(Silent::NoEvents)));
        assert!(!cookie.exists());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn folders_that_other_machines_write_to_are_known_by_their_kind() {
        assert_eq!(shared_kind(0x6969), Some("an NFS mount"));
        // ext4, tmpfs.
        assert_eq!([0xEF53, 0x0102_1994].map(shared_kind), [None, None]);
        assert_eq!(shared(&std::env::temp_dir().join("not/there")), None);
    }

    #[tokio::test]
    async fn a_folder_that_is_not_there_is_polled() {
        let (hints, silent) = Hints::of(Path::new("/nowhere/at/all"), None, |_| true).await;
        assert!(!hints.is_native());
        assert!(matches!(silent, Some(Silent::Refused(_))));
    }
}
