//! Training and rendering of both fields in samples a second: `cargo bench -p mde-nerf`.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mde_nerf::{FieldConfig, HashFieldConfig, MlpFieldConfig, Nerf, NerfConfig, RadianceField, Silent};
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView};
use ndarray::{Array2, Array3};

const HEIGHT: usize = 48;
const WIDTH: usize = 64;
const STEPS: usize = 100;

fn view() -> PosedView {
    let camera = PinholeCamera::from_fov(60.0, WIDTH, HEIGHT).unwrap();
    let image = Array3::from_shape_fn((HEIGHT, WIDTH, 3), |(y, x, c)| {
        0.5 + 0.4 * (0.3 * x as f32 + 0.2 * y as f32 + c as f32).sin()
    });
    let depth = Array2::from_shape_fn((HEIGHT, WIDTH), |(_, x)| 2.0 + 0.02 * x as f32);
    let hypothesis = GaussianDepth::new(depth, Array2::zeros((HEIGHT, WIDTH))).unwrap();
    let mask = Array2::from_elem((HEIGHT, WIDTH), true);
    PosedView::new(image, camera, Pose::identity(), mask, vec![hypothesis]).unwrap()
}

fn fields(c: &mut Criterion) {
    let view = view();
    let fields = [
        ("mlp", FieldConfig::Mlp(MlpFieldConfig::default())),
        ("hash", FieldConfig::Hash(HashFieldConfig::default())),
    ];
    for (name, field) in fields {
        let mut config = NerfConfig { field, ..NerfConfig::default() };
        config.train.steps = STEPS;
        let mut group = c.benchmark_group(name);
        group.sample_size(10);

        let mut nerf = Nerf::new(config.clone(), 0).unwrap();
        let report = nerf.fit(std::slice::from_ref(&view), &mut Silent).unwrap();
        // The fit also measures its PSNR; at this few steps that is about a tenth of it.
        group.throughput(Throughput::Elements(report.samples));
        group.bench_function("fit", |b| {
            b.iter(|| nerf.fit(std::slice::from_ref(&view), &mut Silent).unwrap())
        });

        let samples = HEIGHT * WIDTH * (config.render.coarse + config.render.fine);
        group.throughput(Throughput::Elements(samples as u64));
        group.bench_function("render", |b| {
            b.iter(|| nerf.render(&view.camera, &Pose::identity(), &mut Silent).unwrap());
        });
    }
}

criterion_group!(benches, fields);
criterion_main!(benches);
