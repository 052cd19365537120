//! One training step of recipe `ritz`, beside what its dense products would take at the machine's own rate.
//!
//! `cargo bench --bench training`. The rate is measured in the same run, on two threads at once as the shards are,
//! on the three products of an SGGC layer: forward, gradient of the weights, gradient of the features.

use std::cell::Cell;
use std::hint::black_box;
use std::time::{Duration, Instant};

use chladni::ggnn::network::{Layer, TrunkShape};
use chladni::ggnn::ops::real::Real;
use chladni::ggnn::recipe::Ritz;
use chladni::ggnn::train::{Observer, train_blocks};
use criterion::{Criterion, criterion_group, criterion_main};

use faer::Accum;

use families::{sample, spot};

mod families;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const WIDTH: usize = 128;
const LAYERS: usize = 4;
const SHARDS: usize = 2;

/// Notes when the first step ended, so that what surrounds the steps is left out.
struct Stopwatch {
    first: Cell<Option<Instant>>,
    last: Cell<Option<Instant>>,
}

impl Observer for Stopwatch {
    fn step(&self, _: usize, _: usize, _: f64) {
        let now = Instant::now();
        self.first.set(self.first.get().or(Some(now)));
        self.last.set(Some(now));
    }

    fn cancelled(&self) -> bool {
        false
    }
}

fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("step");
    group.sample_size(10).measurement_time(Duration::from_secs(5));
    for (members, vertices) in [(10, 144), (4, 500)] {
        let family = spot(members, vertices).expect("spot simplifies");
        let recipe = Ritz {
            shape: TrunkShape {
                width: WIDTH,
                layers: LAYERS,
                layer: Layer::Sggc,
                ..Ritz::default().shape
            },
            batch: members,
            shards: SHARDS,
            ..Ritz::default()
        };
        let mut best = f64::INFINITY;
        group.bench_function(format!("{members}x{vertices}"), |bencher| {
            bencher.iter_custom(|count| {
                let samples = family.iter().map(sample).collect();
                let watch = Stopwatch { first: Cell::new(None), last: Cell::new(None) };
                let recipe = Ritz { steps: count as usize + 1, ..recipe };
                train_blocks(samples, &recipe, 1, 0, &watch).expect("the family can be trained on");
                let elapsed = watch.last.get().zip(watch.first.get()).map(|(b, a)| b - a);
                let elapsed = elapsed.expect("there were steps");
                best = best.min(elapsed.as_secs_f64() / count as f64);
                elapsed
            });
        });
        let products: f64 = family.iter().map(|member| flops(member.input.n())).sum();
        let rate = gemm_rate(vertices);
        println!(
            "{members} x {vertices}: best step {:.1} ms; products {:.2} GFLOP at {:.0} GFLOP/s \
             measured: floor {:.1} ms, {:.0} % of the step",
            1e3 * best,
            products / 1e9,
            rate / 1e9,
            1e3 * products / rate,
            100.0 * products / rate / best,
        );
    }
}

/// The layers' products, forward and backward, for one member.
fn flops(n: usize) -> f64 {
    3.0 * (LAYERS * 2 * n * 2 * WIDTH * WIDTH) as f64
}

/// Floating-point operations a second of all shards together, on the products of one layer for `n` vertices.
fn gemm_rate(n: usize) -> f64 {
    const REPEATS: usize = 100;
    let once = || {
        let (x, joined) = (vec![0.1_f32; n * WIDTH], vec![0.1_f32; n * 2 * WIDTH]);
        let (mut next, mut d_joined) = (x.clone(), joined.clone());
        let mut matrix = vec![0.0_f32; 2 * WIDTH * WIDTH];
        let forward = f32::pack_transposed(&matrix, WIDTH, 2 * WIDTH);
        let backward = f32::pack(&matrix, WIDTH, 2 * WIDTH);
        for _ in 0..REPEATS {
            f32::multiply(&mut next, &joined, n, &forward);
            f32::multiply(&mut d_joined, &x, n, &backward);
            f32::transposed_product(&mut matrix, &x, &joined, n, Accum::Add);
        }
        black_box((next, d_joined, matrix));
    };
    let best = (0..5)
        .map(|_| {
            let start = Instant::now();
            std::thread::scope(|scope| (0..SHARDS).for_each(|_| drop(scope.spawn(once))));
            start.elapsed()
        })
        .min();
    let layers = (SHARDS * REPEATS) as f64;
    layers * flops(n) / LAYERS as f64 / best.expect("five runs").as_secs_f64()
}

criterion_group!(benches, steps);
criterion_main!(benches);
