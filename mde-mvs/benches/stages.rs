//! Seconds of the stages on five photographs of 640 x 480: `cargo bench -p mde-mvs`.
//!
//! The sweep's throughput is in comparisons of a pixel with a source on a surface per second (elements).
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mde_mvs::consensus::{agreement, reconstruct};
use mde_mvs::ndarray::{Array2, Array3};
use mde_mvs::patches::refine_by_patches;
use mde_mvs::sweep::{Surfaces, sweep};
use mde_warp::{PinholeCamera, Pose, PosedView};
use std::hint::black_box;

const SIZE: (usize, usize) = (480, 640);
const CENTRES: [[f64; 2]; 5] = [[0.0, 0.0], [0.2, 0.0], [-0.2, 0.05], [0.0, -0.15], [0.1, 0.15]];

/// A textured wall that recedes to the right, as each of five cameras side by side sees it, with its depth.
fn scene() -> (Vec<PosedView>, Vec<Array2<f32>>) {
    let camera = PinholeCamera::from_fov(60.0, SIZE.1, SIZE.0).unwrap();
    // z = 2 + x / 3 in the world.
    let view = |&[cx, cy]: &[f64; 2]| {
        let direction =
            |y: usize, x: usize| ((x as f64 - camera.cx) / camera.fx, (y as f64 - camera.cy) / camera.fy);
        let depth = Array2::from_shape_fn(SIZE, |(y, x)| (2.0 + cx / 3.0) / (1.0 - direction(y, x).0 / 3.0));
        let image = Array3::from_shape_fn((SIZE.0, SIZE.1, 3), |(y, x, _)| {
            let ((u, v), z) = (direction(y, x), depth[(y, x)]);
            let (px, py) = (cx + u * z, cy + v * z);
            let wave = |a: f64, b: f64| (a * px + b * py).sin();
            (0.5 + 0.12 * (wave(97.0, 31.0) + wave(-41.0, 83.0) + wave(17.0, -23.0))) as f32
        });
        let mask = Array2::from_elem(SIZE, true);
        let pose = Pose::translation(-cx, -cy, 0.0);
        (PosedView::new(image, camera, pose, mask, Vec::new()).unwrap(), depth.mapv(|z| z as f32))
    };
    CENTRES.iter().map(view).unzip()
}

fn stages(c: &mut Criterion) {
    let (views, depths) = scene();
    let bend = |x: usize| 1.0 + 0.1 * (x as f32 / 90.0).sin();
    let priors: Vec<Array2<f32>> =
        depths.iter().map(|d| Array2::from_shape_fn(SIZE, |(y, x)| 3.0 * bend(x + y) * d[(y, x)])).collect();
    let all = [0, 1, 2, 3, 4];
    let around = Surfaces::Around { depth: depths[0].view(), factor: 1.5 };
    let found = sweep(&views, 0, &all, around).unwrap();

    let mut group = c.benchmark_group("five photographs of 640 x 480");
    group.sample_size(10);
    let comparisons = (SIZE.0 * SIZE.1 * found.surfaces * 4) as u64;
    group.throughput(Throughput::Elements(comparisons));
    group.bench_function("one sweep", |b| b.iter(|| black_box(sweep(&views, 0, &all, around).unwrap())));
    group.throughput(Throughput::Elements((SIZE.0 * SIZE.1) as u64));
    let maps = vec![&found.depth; views.len()];
    group.bench_function("agreement of one", |b| {
        b.iter(|| black_box(agreement(&views, &maps, 0, &all).unwrap()))
    });
    let near: Vec<Array2<f32>> = depths.iter().map(|d| d.mapv(|z| 1.005 * z)).collect();
    let near: Vec<_> = near.iter().map(|d| d.view()).collect();
    group.bench_function("patches of one", |b| {
        b.iter(|| black_box(refine_by_patches(&views, &near).unwrap()))
    });
    let priors: Vec<_> = priors.iter().map(|p| p.view()).collect();
    group.bench_function("reconstruct", |b| {
        b.iter(|| black_box(reconstruct(&views, &priors, None, &mut mde_mvs::silent).unwrap()))
    });
}

criterion_group!(benches, stages);
criterion_main!(benches);
