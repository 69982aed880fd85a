//! Seconds that all metrics of one map take: `cargo bench -p mde-eval`.
#![allow(missing_docs, clippy::expect_used)]

use criterion::{Criterion, criterion_group, criterion_main};
use mde_eval::scene::{Room, room};
use mde_eval::score::{ScoreConfig, Subject, score};
use mde_eval::simulated::{SimulatedPriorConfig, simulated_prior};
use std::hint::black_box;

fn scores(criterion: &mut Criterion) {
    let truth = room(Room::Study, 0, 640, 480).expect("a room").depth;
    let prior = simulated_prior(&truth, &SimulatedPriorConfig::default()).expect("a prior").map;
    let sigma = prior.mapv(|d| 0.05 * d * d);
    let both = Subject::new(prior.view(), truth.view()).with_sigma(sigma.view());
    let config = ScoreConfig::default();
    let mut group = criterion.benchmark_group("640x480");
    group.sample_size(10);
    group.bench_function("depth and sigma", |b| b.iter(|| score(black_box(&both), &config).expect("scores")));
    group.finish();
}

criterion_group!(benches, scores);
criterion_main!(benches);
