//! How many samples a second the two fields train on and render here: `cargo run --release -p mde-nerf --example throughput`.
#![allow(clippy::print_stdout)]

use mde_nerf::{
    FieldConfig, HashFieldConfig, MlpFieldConfig, Nerf, NerfConfig, RadianceField, Result, Silent,
};
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView};
use ndarray::{Array2, Array3};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (height, width) = (240, 320);
    let camera = PinholeCamera::from_fov(60.0, width, height)?;
    let image = Array3::from_shape_fn((height, width, 3), |(y, x, c)| {
        0.5 + 0.4 * (0.1 * x as f32 + 0.07 * y as f32 + c as f32).sin()
    });
    let depth = Array2::from_shape_fn((height, width), |(y, x)| {
        2.0 + 0.004 * x as f32 + if y > 120 { 0.5 } else { 0.0 }
    });
    let hypothesis = GaussianDepth::new(depth, Array2::zeros((height, width)))?;
    let mask = Array2::from_elem((height, width), true);
    let view = PosedView::new(image, camera, Pose::identity(), mask, vec![hypothesis])?;
    let fields = [
        ("MLP 4x128, 10 octaves", FieldConfig::Mlp(MlpFieldConfig::default())),
        ("hash 8x4, 2^16 rows, 32-32-4", FieldConfig::Hash(HashFieldConfig::default())),
        (
            "hash 12x2, 2^17 rows, 64-16, 64-3",
            FieldConfig::Hash(HashFieldConfig {
                levels: 12,
                features: 2,
                log2_rows: 17,
                layers: 1,
                width: 64,
                geometry: 15,
                ..HashFieldConfig::default()
            }),
        ),
    ];
    for (name, field) in fields {
        let mut config = NerfConfig { field, ..NerfConfig::default() };
        config.train.steps = std::env::args().nth(1).map_or(Ok(100), |s| s.parse())?;
        let mut nerf = Nerf::new(config.clone(), 0)?;
        let start = Instant::now();
        let report = nerf.fit(std::slice::from_ref(&view), &mut Silent)?;
        let training = report.samples as f64 / start.elapsed().as_secs_f64();
        let start = Instant::now();
        nerf.render(&camera, &Pose::identity(), &mut Silent)?;
        let samples = height * width * (config.render.coarse + config.render.fine);
        let rendering = samples as f64 / start.elapsed().as_secs_f64();
        let gflops = |rate: f64, passes: f64| 2.0 * passes * nerf.multiply_adds() as f64 * rate / 1e9;
        println!(
            "{name:34} training {:5.2} M samples/s ({:3.0} GFLOP/s)   rendering {:5.2} M samples/s ({:3.0} GFLOP/s)   {:.1} dB",
            training / 1e6,
            gflops(training, 3.0),
            rendering / 1e6,
            gflops(rendering, 1.0),
            report.psnr[0]
        );
    }
    Ok(())
}
