use super::super::matching::match_features;
use super::*;
use ndarray::{Array2, Array3};
use std::f64::consts::TAU;

const REFERENCE: &str = include_str!("../../../tests/reference/sift.csv");

fn rows(kind: &str) -> Vec<Vec<f64>> {
    let fields = |line: &str| line.split(',').skip(1).map(|v| v.parse().unwrap()).collect();
    REFERENCE.lines().filter(|line| line.starts_with(kind)).map(fields).collect()
}

/// The picture of sift.py, drawn at `scale` times its size and turned by `angle` about the middle.
fn blobs(width: usize, height: usize, scale: f64, angle: f64) -> Array2<f64> {
    let blobs = rows("blob");
    let (sin, cos) = angle.sin_cos();
    let middle = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
    Array2::from_shape_fn((height, width), |(row, column)| {
        let (dx, dy) = ((column as f64 - middle[0]) / scale, (row as f64 - middle[1]) / scale);
        let (x, y) = (dx * cos - dy * sin + 99.5, dx * sin + dy * cos + 74.5);
        let at = |b: &Vec<f64>| {
            let (s, c) = b[4].sin_cos();
            let p = (x - b[0]) * c + (y - b[1]) * s;
            let q = (y - b[1]) * c - (x - b[0]) * s;
            b[5] * (-0.5 * ((p / b[2]).powi(2) + (q / b[3]).powi(2))).exp()
        };
        (0.5 + blobs.iter().map(at).sum::<f64>()).clamp(0.0, 1.0)
    })
}

fn gray(values: &Array2<f64>) -> Array3<f32> {
    let (height, width) = values.dim();
    Array3::from_shape_fn((height, width, 3), |(y, x, _)| values[(y, x)] as f32)
}

fn detect(values: &Array2<f64>) -> Features {
    Features::detect(gray(values).view(), 3000).unwrap()
}

fn turn_between(a: f64, b: f64) -> f64 {
    let turn = (a - b).rem_euclid(TAU);
    turn.min(TAU - turn)
}

/// Nearly every keypoint of OpenCV is here with the same place, size, direction and descriptor, and few others are.
#[test]
fn keypoints_and_descriptors_are_those_of_opencv() {
    let image = blobs(200, 150, 1.0, 0.0).mapv(|v| (v * 255.0 + 0.5).floor() / 255.0);
    let ours = detect(&image);
    let theirs = rows("keypoint");
    let mut found = 0;
    for row in &theirs {
        let near = ours.keypoints.iter().position(|k| {
            (k.pixel - Point2::new(row[0], row[1])).norm() < 0.1
                && (2.0 * k.scale / row[2] - 1.0).abs() < 0.03
                && turn_between(k.angle, row[3].to_radians()) < 0.05
        });
        let alike = near.is_some_and(|i| {
            let sum: f64 = row[5..].iter().sum();
            let pairs = ours.descriptors.row(i).into_iter().zip(&row[5..]);
            pairs.map(|(a, b)| f64::from(*a) * (b / sum).sqrt()).sum::<f64>() > 0.98
        });
        found += usize::from(alike);
    }
    assert!(theirs.len() > 100, "{}", theirs.len());
    assert!(found as f64 >= 0.95 * theirs.len() as f64, "{found} of {}", theirs.len());
    assert!(ours.keypoints.len() as f64 <= 1.05 * theirs.len() as f64, "{}", ours.keypoints.len());
}

/// A gain and an offset change neither where features are nor how they look.
#[test]
fn exposure_changes_no_descriptor() {
    let image = blobs(200, 150, 1.0, 0.0) * 0.4 + 0.1;
    let darker = detect(&(image.mapv(|v| 0.6 * v + 0.05)));
    let plain = detect(&image);
    let pairs = match_features(&plain, &darker);
    assert!(pairs.len() as f64 > 0.9 * darker.keypoints.len() as f64);
    for [i, j] in pairs {
        let moved = plain.keypoints[i].pixel - darker.keypoints[j].pixel;
        assert!(moved.norm() < 0.02, "{moved}");
    }
}

/// Turned by 30 degrees and enlarged by 1.5, most features are found again where the similarity puts them.
#[test]
fn features_follow_a_similarity() {
    let (scale, angle) = (1.5, TAU / 12.0);
    let plain = detect(&blobs(200, 150, 1.0, 0.0));
    let moved = detect(&blobs(330, 330, scale, angle));
    let pairs = match_features(&plain, &moved);
    let right = pairs
        .iter()
        .filter(|[i, j]| {
            let there = moved.keypoints[*j];
            let (dx, dy) = ((there.pixel.x - 164.5) / scale, (there.pixel.y - 164.5) / scale);
            let (sin, cos) = angle.sin_cos();
            let back = Point2::new(dx * cos - dy * sin + 99.5, dx * sin + dy * cos + 74.5);
            let here = plain.keypoints[*i];
            (back - here.pixel).norm() < 0.5 && (there.scale / (scale * here.scale) - 1.0).abs() < 0.2
        })
        .count();
    assert!(right > 60 && right as f64 > 0.9 * pairs.len() as f64, "{right} of {}", pairs.len());
}

/// A photograph above the limit is reduced, and its features are still where they were.
#[test]
fn reduction_keeps_the_places_of_features() {
    let image = blobs(400, 300, 2.0, 0.0);
    let full = detect(&image);
    let reduced = Features::detect_within(gray(&image).view(), 3000, 40_000).unwrap();
    let pairs = match_features(&full, &reduced);
    let shift = |&[i, j]: &[usize; 2]| full.keypoints[i].pixel - reduced.keypoints[j].pixel;
    let mut shifts: Vec<_> = pairs.iter().map(shift).collect();
    assert!(shifts.len() > 40, "{}", shifts.len());
    for axis in 0..2 {
        shifts.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
        assert!(shifts[shifts.len() / 2][axis].abs() < 0.03);
    }
}

#[test]
fn the_strongest_are_kept() {
    let image = blobs(200, 150, 1.0, 0.0);
    let all = detect(&image);
    let few = Features::detect(gray(&image).view(), 20).unwrap();
    assert_eq!(few.keypoints, all.keypoints[..20]);
    assert!(all.keypoints.windows(2).all(|pair| pair[0].response >= pair[1].response));
}

#[test]
fn what_cannot_be_read_is_refused() {
    let of = |shape| Features::detect(Array3::zeros(shape).view(), 3000);
    assert!(of((20, 20, 1)).unwrap_err().to_string().contains("channels"));
    assert!(of((20, 8, 3)).unwrap_err().to_string().contains("16 pixels"));
    assert_eq!(of((20, 20, 3)).unwrap().keypoints.len(), 0);
}
