//! The coefficients of the probability that a sweep's match is right (`CHANCE` of `mde_mvs::consensus`): a logistic regression
//! on procedural captures of "within 10 % of the true depth".
//!
//! `cargo run --release -p mde-eval --example match_chance -- [seeds]`
//!
//! The rooms are photographed with seeds 1, 2, ... under several conditions, with 1 % of noise on the colours. Seed 0 is left to
//! the evaluation. Each capture has the same weight.
#![allow(clippy::print_stdout)]

use mde_eval::mde_mvs::consensus::reconstruct;
use mde_eval::mde_mvs::silent;
use mde_eval::mde_prior::DisparityRule;
use mde_eval::mde_uncertainty::random::CounterRng;
use mde_eval::nalgebra::{SMatrix, SVector};
use mde_eval::ndarray::{Array2, ArrayView2};
use mde_eval::scene::{CaptureConfig, Room, World};
use rand_distr::{Distribution, Normal};

const SIZE: (usize, usize) = (320, 240);
/// Photographs, baseline over depth, pose noise in degrees, gain of one photograph.
const CONDITIONS: [(usize, f64, f64, f64); 3] = [(5, 0.1, 0.0, 0.0), (5, 0.05, 0.1, 0.2), (3, 0.2, 0.1, 0.0)];
/// Standard deviation of the colours' noise.
const NOISE: f32 = 0.01;
/// Every so many pixels one is used.
const STEP: usize = 5;

type Terms = SVector<f64, 5>;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seeds: u64 = std::env::args().nth(1).as_deref().unwrap_or("1").parse()?;
    let mut samples: Vec<(Terms, bool, f64)> = Vec::new();
    for (room, seed) in Room::ALL.into_iter().flat_map(|room| (1..=seeds).map(move |seed| (room, seed))) {
        for (views, baseline, pose_noise, gain) in CONDITIONS {
            let config = CaptureConfig { views, baseline, pose_noise, gain, seed };
            let title = format!("{room} {seed}, {views} at {baseline}");
            match capture(room, &config) {
                Ok(found) => {
                    let right = found.iter().filter(|(_, right)| *right).count();
                    println!("{title}: {right} of {} matches right", found.len());
                    let weight = 1.0 / found.len().max(1) as f64;
                    samples.extend(found.into_iter().map(|(terms, right)| (terms, right, weight)));
                }
                Err(error) => println!("{title}: left out: {error}"),
            }
        }
    }
    let (coefficients, gain) = logistic(&samples);
    println!("coefficients {:.2?}", coefficients.as_slice());
    println!("log likelihood per match {gain:.4}");
    Ok(())
}

/// Terms of every match of the reference, and whether it is right.
fn capture(room: Room, config: &CaptureConfig) -> Result<Vec<(Terms, bool)>, Box<dyn std::error::Error>> {
    let capture = World::new(room, config.seed)?.capture("room", config, SIZE.0, SIZE.1)?;
    let noise = Normal::new(0.0, NOISE)?;
    let mut views = Vec::new();
    let mut priors: Vec<Array2<f32>> = Vec::new();
    for (index, captured) in capture.views.iter().enumerate() {
        let mut rng = CounterRng::new(config.seed, "photograph-noise", 0, index as u64);
        let mut view = captured.view.clone();
        view.image.mapv_inplace(|c| (c + noise.sample(&mut rng)).clamp(0.0, 1.0));
        views.push(view);
        let prior = captured.prior.as_ref().ok_or("a photograph without a prior")?;
        priors.push(prior.to_depth(&DisparityRule::default())?);
    }
    let maps: Vec<ArrayView2<'_, f32>> = priors.iter().map(|prior| prior.view()).collect();
    let found = reconstruct(&views, &maps, None, &mut silent)?;
    let Some(reference) = found.views.first() else { return Ok(Vec::new()) };
    let (sweep, agreement) = (&reference.sweep, &reference.agreement);
    let mut samples = Vec::new();
    for (at, &truth) in capture.truth.indexed_iter().step_by(STEP) {
        let (Some((z, _)), mass) = (sweep.depth.get(at.0, at.1), f64::from(sweep.inlier[at])) else {
            continue;
        };
        // A match at the end of the surfaces is none.
        if mass == 0.0 || truth <= 0.0 || z <= 0.0 {
            continue;
        }
        let odds = (mass.max(1e-3) / (1.0 - mass).max(0.02)).ln();
        let (agree, visible) = (agreement.agree[at], agreement.visible[at]);
        let none = if agree == 0 { 1.0 } else { 0.0 };
        let terms = [1.0, odds, f64::from(visible - agree), none, f64::from(sweep.cost[at])];
        samples.push((Terms::from(terms), (f64::from(z / truth) - 1.0).abs() < 0.1));
    }
    Ok(samples)
}

/// Maximum likelihood by Newton's method, and the mean log likelihood.
fn logistic(samples: &[(Terms, bool, f64)]) -> (Terms, f64) {
    let mut coefficients = Terms::zeros();
    let mut likelihood = 0.0;
    for _ in 0..30 {
        let mut slope = Terms::zeros();
        let mut curvature = SMatrix::<f64, 5, 5>::identity() * 1e-9;
        let mut total = 0.0;
        likelihood = 0.0;
        for (terms, right, weight) in samples {
            let p = 1.0 / (1.0 + (-coefficients.dot(terms)).exp());
            let hit = if *right { 1.0 } else { 0.0 };
            slope += terms * (weight * (hit - p));
            curvature += terms * terms.transpose() * (weight * p * (1.0 - p));
            likelihood += weight * if *right { p } else { 1.0 - p }.max(1e-300).ln();
            total += weight;
        }
        likelihood /= total.max(1e-12);
        let Some(step) = curvature.cholesky().map(|c| c.solve(&slope)) else { break };
        coefficients += step;
        if step.norm() < 1e-9 {
            break;
        }
    }
    (coefficients, likelihood)
}
