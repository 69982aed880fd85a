//! Fits of a scene whose colours and depths are known in closed form.

#![allow(clippy::unwrap_used)]

use mde_nerf::{
    Error, FieldConfig, FieldEvent, HashFieldConfig, MlpFieldConfig, Nerf, NerfConfig, RadianceField,
    RenderedView, silent,
};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::{Point2, Point3, Translation3, UnitQuaternion};
use ndarray::{Array2, Array3};
use rand::RngExt;
use std::ops::ControlFlow;

const WIDTH: usize = 48;
const HEIGHT: usize = 36;

/// A textured wall at 3 with a textured square before it at 2: what a ray meets first, and its colour.
fn trace(origin: &Point3<f64>, direction: &nalgebra::Vector3<f64>) -> (f64, [f32; 3]) {
    let at = |z: f64| origin + direction * ((z - origin.z) / direction.z);
    let near = at(2.0);
    let (hit, shade) = if near.x.abs() < 0.5 && near.y.abs() < 0.4 { (near, 0.35) } else { (at(3.0), 0.0) };
    let wave = |k: f64, x: f64| (0.5 + 0.4 * (k * x).sin()) as f32;
    (hit.z, [wave(5.0, hit.x), wave(4.0, hit.y + shade), wave(3.0, hit.x + 2.0 * hit.y + 3.0 * shade)])
}

fn camera() -> PinholeCamera {
    PinholeCamera::from_fov(60.0, WIDTH, HEIGHT).unwrap()
}

/// The view from a pose, with its exact depth as hypothesis on request.
fn view(pose: Pose, hypothesis: bool) -> PosedView {
    let camera = camera();
    let inverse = pose.inverse();
    let origin = inverse * Point3::origin();
    let mut image = Array3::zeros((HEIGHT, WIDTH, 3));
    let mut depth = Array2::zeros((HEIGHT, WIDTH));
    for ((row, column), d) in depth.indexed_iter_mut() {
        let direction = inverse * camera.ray(Point2::new(column as f64, row as f64));
        let (z, colour) = trace(&origin, &direction);
        *d = (pose * (origin + direction * ((z - origin.z) / direction.z))).z as f32;
        for (channel, c) in colour.into_iter().enumerate() {
            image[(row, column, channel)] = c;
        }
    }
    let known = || GaussianDepth::new(depth, Array2::from_elem((HEIGHT, WIDTH), 1e-4)).unwrap();
    let hypotheses = hypothesis.then(known).into_iter().collect();
    PosedView::new(image, camera, pose, Array2::from_elem((HEIGHT, WIDTH), true), hypotheses).unwrap()
}

/// Nine views around the origin with real parallax.
fn views(hypotheses: bool) -> Vec<PosedView> {
    let mut views = vec![view(Pose::identity(), true)];
    for i in 0..8 {
        let angle = f64::from(i) * std::f64::consts::FRAC_PI_4;
        let shift = Translation3::new(0.25 * angle.cos(), 0.25 * angle.sin(), 0.0);
        let turn = UnitQuaternion::from_euler_angles(0.02 * angle.sin(), -0.02 * angle.cos(), 0.0);
        views.push(view(Pose::from_parts(shift, turn), hypotheses));
    }
    views
}

/// A configuration of a field that is fitted in seconds.
fn quick(field: FieldConfig, steps: usize, learning_rate: f64) -> NerfConfig {
    let mut config = NerfConfig { field, ..NerfConfig::default() };
    (config.train.steps, config.train.rays, config.train.warm_up) = (steps, 512, 20);
    config.train.learning_rate = learning_rate;
    config
}

fn hash() -> NerfConfig {
    let field = HashFieldConfig { log2_rows: 14, finest: 96, ..HashFieldConfig::default() };
    quick(FieldConfig::Hash(field), 150, 1e-2)
}

fn mlp() -> NerfConfig {
    quick(FieldConfig::Mlp(MlpFieldConfig { layers: 3, width: 64, frequencies: 5 }), 500, 5e-3)
}

/// A fitted field, and the original pose as it renders it.
fn fitted(config: NerfConfig, views: &[PosedView]) -> (Nerf, RenderedView) {
    let mut field = Nerf::new(config, 1).unwrap();
    field.fit(views, &mut silent).unwrap();
    let seen = field.render(&views[0].camera, &views[0].pose, &mut silent).unwrap();
    (field, seen)
}

#[test]
fn parallax_alone_teaches_a_field_colour_and_depth() {
    let views = views(false);
    let mut hash = hash();
    hash.train.steps = 400;
    for (config, least) in [(hash, 30.0), (mlp(), 28.0)] {
        let (_, seen) = fitted(config, &views);
        let error = (&seen.image - &views[0].image).mapv(|e| f64::from(e * e)).mean().unwrap();
        let psnr = -10.0 * error.log10();
        assert!(psnr > least, "PSNR {psnr:.1} dB");
        let depths = views[0].hypotheses[0].mean().into_iter().zip(seen.depth.mean());
        let depth = median(depths.map(|(exact, got)| (got / exact - 1.0).abs())).unwrap();
        assert!(depth < 0.05, "median relative depth error {depth:.4}");
    }
}

/// Photographs from far apart, some of which look past the volume, with hypotheses of 4 % noise: colours sharpen them.
#[test]
fn photographs_from_far_apart_refine_noisy_hypotheses() {
    let turned = |[x, y, z]: [f64; 3], [roll, pitch, yaw]: [f64; 3]| {
        Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
    };
    let poses = [
        Pose::identity(),
        Pose::translation(-0.6, 0.0, 0.0),
        Pose::translation(0.5, 0.2, 0.0),
        turned([0.3, -0.4, -0.5], [0.05, 0.15, 0.02]),
        turned([0.0, 0.3, 0.8], [-0.1, 0.1, 0.0]),
    ];
    let mut exact = Vec::new();
    let mut views = Vec::new();
    for (index, pose) in poses.into_iter().enumerate() {
        let mut view = view(pose, true);
        let mut rng = CounterRng::new(5, "noise", index as u64, 0);
        let depth = view.hypotheses[0].mean().to_owned();
        let noisy = depth.mapv(|z| z * (1.0 + 0.08 * (rng.random::<f32>() + rng.random::<f32>() - 1.0)));
        view.hypotheses = vec![GaussianDepth::new(noisy, depth.mapv(|z| (0.033 * z).powi(2))).unwrap()];
        exact.push(depth);
        views.push(view);
    }
    let mut config = NerfConfig::photographs(WIDTH);
    (config.train.steps, config.train.rays) = (200, 512);
    let (field, rendered) = fitted(config, &views);
    let error = |depth: ndarray::ArrayView2<f32>| {
        let relative = depth.iter().zip(&exact[0]).map(|(got, exact)| f64::from((got / exact - 1.0).abs()));
        relative.sum::<f64>() / exact[0].len() as f64
    };
    let [before, after] = [views[0].hypotheses[0].mean().view(), rendered.depth.mean().view()].map(error);
    assert!(after < 0.5 * before, "mean relative error {before:.4} before, {after:.4} after");
    // Away from the volume there is nothing.
    let turned = Pose::rotation(nalgebra::Vector3::new(0.0, std::f64::consts::PI, 0.0));
    let away = field.render(&views[0].camera, &turned, &mut silent).unwrap();
    assert!(away.opacity.iter().all(|&a| a == 0.0) && away.depth.support().iter().all(|known| !known));
}

/// Two hypotheses 20 % apart with 2 % each: their mixture has a standard deviation of 10.2 %. The weight is one at which colours hardly
/// matter: the median is then 10.1 %.
#[test]
fn the_termination_becomes_the_distribution_of_the_hypotheses() {
    let mut views = views(true);
    for view in &mut views {
        let exact = view.hypotheses[0].clone();
        let moved = |by: f32| exact.clone().map(|z, _| (by * z, (0.02 * z).powi(2)));
        view.hypotheses = vec![moved(0.9), moved(1.1)];
    }
    let mut config = hash();
    config.train.depth_weight = 25.0;
    let (_, seen) = fitted(config, &views);
    let sigmas = seen.depth.sigma();
    let median = median(sigmas.iter().zip(seen.depth.mean()).map(|(sigma, mean)| sigma / mean)).unwrap();
    assert!((0.09..0.115).contains(&median), "{median}");
}

#[test]
fn the_same_seed_gives_the_same_bits_with_any_number_of_threads() {
    let mut config = hash();
    config.train.steps = 30;
    let views = views(true);
    let run = |threads: usize, config: &NerfConfig| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut field = Nerf::new(config.clone(), 7).unwrap();
            let report = field.fit(&views, &mut silent).unwrap();
            (report, field.render(&views[1].camera, &views[1].pose, &mut silent).unwrap())
        })
    };
    for field in
        [config.field.clone(), FieldConfig::Mlp(MlpFieldConfig { layers: 2, width: 32, frequencies: 4 })]
    {
        config.field = field;
        let one = run(1, &config);
        assert_eq!(one, run(2, &config));
        assert_eq!(one, run(5, &config));
    }
}

/// Fitted again, a loaded field is the same field: it has the settings that no configuration file has, too.
#[test]
fn a_saved_field_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.safetensors");
    let views = views(true);
    let mut photographs = NerfConfig::photographs(WIDTH);
    photographs.train.rays = 64;
    (photographs.sampling.near, photographs.sampling.far) = (Some(1.1), Some(5.0));
    for mut config in [photographs, mlp()] {
        config.train.steps = 10;
        let mut field = Nerf::new(config, 3).unwrap();
        assert_eq!(field.to_file(), None);
        field.fit(&views, &mut silent).unwrap();
        std::fs::write(&path, field.to_file().unwrap()).unwrap();
        let mut again = Nerf::load(&path).unwrap();
        assert_eq!(again.to_file(), field.to_file());
        let render = |f: &Nerf| f.render(&views[2].camera, &views[2].pose, &mut silent).unwrap();
        assert_eq!(render(&again), render(&field));
        again.fit(&views, &mut silent).unwrap();
        assert_eq!(render(&again), render(&field));
    }
}

#[test]
fn a_larger_view_gets_more_steps_with_steps_for() {
    let views = [view(Pose::identity(), true)];
    let pixels = views[0].camera.width * views[0].camera.height;
    let steps = |steps_for: usize| {
        let mut config = hash();
        (config.train.steps, config.train.rays, config.train.steps_for) = (10, 16, steps_for);
        Nerf::new(config, 0).unwrap().fit(&views, &mut silent).unwrap().steps
    };
    assert_eq!([0, 2 * pixels, pixels, pixels / 3].map(steps), [10, 10, 10, 30]);
}

#[test]
fn the_callback_receives_progress_and_cancels_both_calls() {
    let views = views(true);
    let mut config = hash();
    config.train.steps = 50;
    let mut field = Nerf::new(config, 0).unwrap();
    let mut events = 0;
    let stopped = field.fit(&views, &mut |event: &FieldEvent| {
        events += 1;
        assert!(matches!(event, FieldEvent::Fit { steps: 50, .. }));
        ControlFlow::Break(())
    });
    assert!(matches!(stopped, Err(Error::Interrupted)) && events == 1);
    assert!(matches!(field.render(&camera(), &Pose::identity(), &mut silent), Err(Error::NotFitted)));
    field.fit(&views, &mut silent).unwrap();
    let stopped = field.render(&camera(), &Pose::identity(), &mut |_: &FieldEvent| ControlFlow::Break(()));
    assert!(matches!(stopped, Err(Error::Interrupted)));
    let mut wild = mlp();
    (wild.train.steps, wild.train.learning_rate) = (1, 1e20);
    let diverged = Nerf::new(wild, 0).unwrap().fit(&views, &mut silent);
    assert!(matches!(diverged, Err(Error::Diverged { step: 0 })), "{diverged:?}");
    let wide = PinholeCamera { width: usize::MAX, ..camera() };
    assert!(matches!(field.render(&wide, &Pose::identity(), &mut silent), Err(Error::View { .. })));
    let nowhere = Pose::translation(f64::NAN, 0.0, 0.0);
    assert!(matches!(field.render(&camera(), &nowhere, &mut silent), Err(Error::View { .. })));
}

#[test]
fn bad_views_are_named() {
    let mut field = Nerf::new(hash(), 0).unwrap();
    assert!(matches!(field.fit(&[], &mut silent), Err(Error::NoPixels)));
    let mut dark = view(Pose::identity(), true);
    dark.mask.fill(false);
    assert!(matches!(field.fit(&[dark], &mut silent), Err(Error::NoPixels)));
    assert!(matches!(field.fit(&[view(Pose::identity(), false)], &mut silent), Err(Error::NoRange)));
    let mut torn = view(Pose::identity(), true);
    torn.image = Array3::zeros((2, 2, 3)).into_shared();
    assert!(matches!(field.fit(&[torn], &mut silent), Err(Error::View { index: 0, .. })));
}
