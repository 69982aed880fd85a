//! Scores a predicted depth map against a true one, with its standard deviations where there are some, as JSON.
//!
//! `cargo run --release -p mde-eval --example score_maps -- prediction.npy truth.npy [sigma.npy]`
#![allow(clippy::print_stdout)]

use mde_eval::mde_prior::format::{ReadOptions, read_depth};
use mde_eval::score::{ScoreConfig, Subject, score};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let (prediction, truth, sigma) = match paths.as_slice() {
        [prediction, truth] => (prediction, truth, None),
        [prediction, truth, sigma] => (prediction, truth, Some(sigma)),
        _ => Err("give a predicted and a true map (.npy, .npz, .pfm, .png, .exr), then sigma if any")?,
    };
    let read = |path: &String| read_depth(path, &ReadOptions::default());
    let (prediction, truth) = (read(prediction)?, read(truth)?);
    let sigma = sigma.map(read).transpose()?;
    let mut subject = Subject::new(prediction.view(), truth.view());
    if let Some(sigma) = &sigma {
        subject = subject.with_sigma(sigma.view());
    }
    println!("{}", serde_json::to_string_pretty(&score(&subject, &ScoreConfig::default())?)?);
    Ok(())
}
