//! Many small meshes: what engine, store and publishing cost beside the numerics, how fast a run is whose results are all
//! there, and whether memory and cache stay bounded.
//!
//! `cargo bench --bench soak -- [MESHES]`, 1000 if it is not said.

use std::error::Error;
use std::fmt::Write;
use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use chladni::flow::events::{Event, EventFile, EventSink, How};
use chladni::mesh::{TriMesh, sample::icosphere};
use chladni::pipeline::{Method, Pipeline};
use chladni::publish::report::Status;
use chladni::stages::context::Context;
use chladni::stages::intake::{self, Job};
use chladni::stages::run::{OnFailure, Run, run};
use chladni::stages::{assemble, candidates, ingest, verify};
use chladni::store::Store;
use tokio_util::sync::CancellationToken;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let count = std::env::args().skip(1).find_map(|argument| argument.parse().ok()).unwrap_or(1000);
    let dir = tempfile::tempdir()?;
    let soak = Soak::new(dir.path(), count)?;
    println!("{count} meshes of 162 vertices, method = \"fem\", K = {}", soak.pipeline.train.k);

    let numerics = soak.numerics()?;
    println!(
        "numerics alone         {:8.2} s, {:.2} ms a mesh",
        numerics,
        1e3 * numerics / count as f64
    );

    let store = Store::open(dir.path().join("cache"))?;
    let cold = soak.run(&store, "out", 1)?;
    let overhead = 1e3 * (cold.seconds - numerics) / count as f64;
    println!("first run, one worker  {cold}; {overhead:.2} ms a mesh beside the numerics");
    println!("again                  {}", soak.run(&store, "out", 1)?);
    let stat = store.stat()?;
    let (live, disk) = (stat.live_bytes, stat.disk_bytes);
    println!("its cache: {} entries, {live} bytes, {disk} on disk", stat.entries);
    drop(store);
    let store = Store::open(dir.path().join("cache"))?;
    println!("reopened, two workers  {}", soak.run(&store, "out", 2)?);
    println!("into an empty folder   {}", soak.run(&store, "elsewhere", 2)?);
    drop(store);

    let limit = live / 4;
    let store = Store::open(dir.path().join("small cache"))?;
    store.limit(limit)?;
    let capped = soak.run(&store, "capped", 2)?;
    let live = store.stat()?.live_bytes;
    println!("cache of a quarter     {capped}; {live} of {limit} bytes");
    assert!(live <= limit);
    Ok(())
}

/// A folder of meshes to be run over and over.
struct Soak {
    dir: PathBuf,
    jobs: Vec<Job>,
    pipeline: Pipeline,
}

/// How a run went.
struct Ran {
    seconds: f64,
    meshes: usize,
    computed: usize,
    /// Resident memory in MiB, after each tenth of the meshes.
    memory: Vec<f64>,
}

impl std::fmt::Display for Ran {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let memory: Vec<String> =
            self.memory.iter().map(|mebibytes| format!("{mebibytes:.0}")).collect();
        write!(
            f,
            "{:8.2} s, {:.0} meshes a second, {} results computed, MiB {}",
            self.seconds,
            self.meshes as f64 / self.seconds,
            self.computed,
            memory.join(" ")
        )
    }
}

impl Soak {
    /// Spheres, each drawn out a little more.
    fn new(dir: &Path, count: usize) -> Outcome<Self> {
        let folder = dir.join("meshes");
        fs::create_dir(&folder)?;
        let sphere = icosphere(2);
        for i in 0..count {
            let factor = 1.0 + 1e-3 * (i + 1) as f64;
            let vertices = sphere.vertices().iter().map(|&[x, y, z]| [factor * x, y, z]).collect();
            let mesh = TriMesh::new(vertices, sphere.faces().to_vec())?;
            fs::write(folder.join(format!("{i:05}.obj")), obj(&mesh)?)?;
        }
        let mut pipeline = Pipeline::default();
        pipeline.train.method = Method::Fem;
        pipeline.train.k = 8.into();
        Ok(Self { dir: dir.to_owned(), jobs: intake::jobs(&[folder])?, pipeline })
    }

    /// Seconds that the stages take without engine, store and files of results.
    fn numerics(&self) -> Outcome<f64> {
        let context = Context::alone(self.pipeline.clone(), None, self.dir.clone());
        let started = Instant::now();
        for job in &self.jobs {
            let loaded = ingest::ingest(&context, job.clone())?;
            let assembled = assemble::assemble(&context, 0, loaded)?;
            let candidates = candidates::solve(&context, 0, assembled)?;
            verify::verify(&context, 0, candidates)?;
        }
        Ok(started.elapsed().as_secs_f64())
    }

    /// A whole run with results in the folder `out`.
    fn run(&self, store: &Store, out: &str, workers: usize) -> Outcome<Ran> {
        let out = self.dir.join(out);
        fs::create_dir_all(&out)?;
        let sink = Arc::new(Sampler {
            file: EventFile::append(&out.join("events.jsonl"))?,
            every: (self.jobs.len() / 10).max(1),
            seen: Mutex::default(),
        });
        let started = Instant::now();
        let ended = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .enable_all()
            .build()?
            .block_on(run(Run {
                pipeline: self.pipeline.clone(),
                model: None,
                jobs: self.jobs.clone(),
                out,
                store: Some(store.clone()),
                workers: NonZeroUsize::new(workers).ok_or("no workers")?,
                memory: u64::MAX,
                on_failure: OnFailure::Stop,
                retries: 0,
                cancel: CancellationToken::new(),
                time_limit: None,
                lineage: true,
                checkpoint_every: Duration::MAX,
                events: sink.clone(),
            }))?;
        let seconds = started.elapsed().as_secs_f64();
        if let Some(mesh) = ended.report.meshes.iter().find(|mesh| mesh.status != Status::Verified)
        {
            return Err(format!("{}: {:?}", mesh.path, mesh.reason).into());
        }
        let seen = sink.seen.lock().map_err(|_| "a listener panicked")?;
        let (computed, memory) = (seen.computed, seen.memory.clone());
        Ok(Ran { seconds, meshes: self.jobs.len(), computed, memory })
    }
}

/// Logs events as a real run does, and looks at the memory now and then.
struct Sampler {
    file: EventFile,
    every: usize,
    seen: Mutex<Seen>,
}

#[derive(Default)]
struct Seen {
    certified: usize,
    computed: usize,
    memory: Vec<f64>,
}

impl EventSink for Sampler {
    fn record(&self, event: &Event) {
        self.file.record(event);
        let Ok(mut seen) = self.seen.lock() else { return };
        seen.computed += usize::from(event.how == How::Computed);
        if event.stage == "certify" {
            seen.certified += 1;
            if seen.certified.is_multiple_of(self.every) {
                seen.memory.extend(resident());
            }
        }
    }
}

/// Resident memory in MiB, on Linux.
fn resident() -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.trim().strip_suffix(" kB")?.parse::<f64>().ok()? / 1024.0)
}

fn obj(mesh: &TriMesh) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    for [x, y, z] in mesh.vertices() {
        writeln!(text, "v {x:?} {y:?} {z:?}")?;
    }
    for [a, b, c] in mesh.faces() {
        writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1)?;
    }
    Ok(text)
}
