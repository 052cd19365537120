//! What another process sees of a held store, and what a killed one leaves behind.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use chladni::store::{Store, StoreError};
use tempfile::TempDir;

use super::{COST, get, key, open, quarantined_databases, sample};

const CHILD_DIR: &str = "CHLADNI_TEST_STORE";

/// Runs `child_process` below in another process, on `dir`.
fn spawn(dir: &Path) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "processes::child_process", "--nocapture"])
        .env(CHILD_DIR, dir)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Not a test by itself: opens the store that its environment names, and puts entries until it is killed.
#[test]
fn child_process() {
    let Some(dir) = std::env::var_os(CHILD_DIR) else {
        return;
    };
    let say = |line: String| {
        let mut out = std::io::stdout().lock();
        writeln!(out, "\n{line}").and_then(|()| out.flush()).unwrap();
    };
    match Store::open(dir) {
        Err(error) => say(format!("child: {error}")),
        Ok(store) => {
            for n in 0.. {
                store.put(&key(n % 30), &sample(100_000, (n % 30) as u8), COST).unwrap();
                say(format!("child: put {n}"));
            }
        }
    }
}

fn child_lines(child: &mut Child) -> impl Iterator<Item = String> {
    let lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    lines.filter_map(|line| Some(line.strip_prefix("child: ")?.to_owned()))
}

#[test]
fn a_second_opening_names_the_process_that_holds_the_directory() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    let message = Store::open(dir.path()).unwrap_err().to_string();
    let ours = format!("is in use by process {};", std::process::id());
    assert!(message.contains(&ours), "{message}");
    assert!(message.contains("--cache"), "{message}");

    let mut child = spawn(dir.path());
    let messages: Vec<_> = child_lines(&mut child).collect();
    assert_eq!(messages.len(), 1);
    assert!(messages[0].contains(&ours), "{}", messages[0]);
    assert!(child.wait().unwrap().success());

    let clone = store.clone();
    drop(store);
    assert!(Store::open(dir.path()).is_err(), "a clone still holds it");
    drop(clone);
    assert!(Store::open(dir.path()).is_ok());
}

#[test]
fn a_killed_process_leaves_no_lock_and_no_half_entry() {
    let dir = TempDir::new().unwrap();
    for _ in 0..3 {
        let mut child = spawn(dir.path());
        let last = child_lines(&mut child).nth(12).unwrap();
        match Store::open(dir.path()) {
            Err(StoreError::Locked { holder, .. }) => assert_eq!(holder, Some(child.id())),
            other => panic!("expected Locked, found {other:?}"),
        }
        child.kill().unwrap();
        child.wait().unwrap();

        let store = open(dir.path());
        assert!(last.starts_with("put "), "{last}");
        let found = (0..13).filter(|&n| match get(&store, &key(n)) {
            Some(found) => found == sample(100_000, n as u8),
            // Only the entry that was being replaced may be absent.
            None => false,
        });
        assert!(found.count() >= 12);
        assert!(store.quarantined().unwrap().is_empty());
        assert!(quarantined_databases(dir.path()).is_empty());
    }
}
