//! A photograph beside what the field renders from its place.

use ndarray::Array3;
use serde::Serialize;

/// A photograph, what the field renders from its place, and how far they differ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NovelView {
    /// Index among the capture's photographs.
    pub photograph: usize,
    /// Whether its colours and its depth took no part in sweeps and fit. Its matches took part in the pose estimation.
    pub withheld: bool,
    /// PSNR of the field's rendering, dB.
    pub psnr: Option<f64>,
    /// PSNR of the reference moved there by the gauged prior, over the same pixels, dB.
    pub psnr_of_prior: Option<f64>,
    /// Share of its pixels that are compared: those which the field renders and the moved reference reaches.
    pub compared: f64,
    /// The photograph in the reference's exposure, `[height, width, 3]`, at most 320 pixels a side.
    #[serde(skip)]
    pub image: Array3<f32>,
    /// The field's rendering, of the same size; grey where the field has nothing.
    #[serde(skip)]
    pub rendered: Array3<f32>,
}
