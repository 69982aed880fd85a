//! The stages of both fields beside the machine's peak: `cargo bench -p mde-nerf --features bench`.
//!
//! Throughput is in samples per second (elements), floating-point operations per second for the peak, bytes per second for
//! memory. `mde bench` prints the same as one table.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mde_nerf::NerfConfig;
use mde_nerf::stages::{multiply_adds, random_lines, stages};
use std::hint::black_box;

fn ceilings(c: &mut Criterion) {
    let mut group = c.benchmark_group("ceiling");
    group.throughput(Throughput::Elements(multiply_adds(1 << 16).0));
    group.bench_function("multiply-adds, one thread", |b| b.iter(|| black_box(multiply_adds(1 << 16))));
    let table = vec![1.0; 1 << 21];
    group.throughput(Throughput::Bytes(random_lines(&table, 1 << 16).0));
    group.bench_function("random lines of 8 MiB, one thread", |b| {
        b.iter(|| black_box(random_lines(&table, 1 << 16)))
    });
}

fn fields(c: &mut Criterion) {
    for (name, field) in mde_nerf::stages::fields() {
        let mut group = c.benchmark_group(name);
        group.sample_size(10);
        let config = NerfConfig { field, ..NerfConfig::default() };
        stages(&config, &mut |mut stage| {
            group.throughput(Throughput::Elements(stage.samples));
            group.bench_function(stage.name, |b| b.iter(|| stage.run()));
        })
        .unwrap();
    }
}

criterion_group!(benches, ceilings, fields);
criterion_main!(benches);
