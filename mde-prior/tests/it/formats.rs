//! Round trips, and files that are not what they claim.

use crate::place;
use mde_prior::format::{self, Format, ReadOptions};
use mde_prior::ndarray::{Array2, array};
use mde_prior::{DepthKind, DepthPrior, FilePrior, photo};
use proptest::prelude::*;
use proptest::sample::Index;

fn maps(value: impl Strategy<Value = f32> + Clone) -> impl Strategy<Value = Array2<f32>> {
    (1_usize..9, 1_usize..9).prop_flat_map(move |(h, w)| {
        proptest::collection::vec(value.clone(), h * w)
            .prop_map(move |v| Array2::from_shape_vec((h, w), v).unwrap())
    })
}

/// Every f32 but NaN: signed zeros, subnormals, infinities.
fn numbers() -> impl Strategy<Value = f32> + Clone {
    any::<u32>().prop_map(f32::from_bits).prop_filter("NaN is refused", |v| !v.is_nan())
}

/// A valid file of each format.
fn samples() -> Vec<(Format, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let map = Array2::from_shape_fn((5, 7), |(y, x)| 0.5 + y as f32 + 0.25 * x as f32);
    let mut files: Vec<_> = ["a.png", "a.npy", "a.npz", "a.pfm", "a.exr"]
        .into_iter()
        .map(|name| {
            let path = folder.path().join(name);
            format::write_depth(&path, map.view()).unwrap();
            (Format::of(&path).unwrap(), std::fs::read(&path).unwrap())
        })
        .collect();
    files.push((Format::Npz, deflated(&map)));
    files
}

/// What another implementation compresses.
fn deflated(map: &Array2<f32>) -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    let mut writer = ndarray_npy::NpzWriter::new_compressed(&mut file);
    writer.add_array("depth", map).unwrap();
    writer.finish().unwrap();
    file.into_inner()
}

proptest! {
    #[test]
    fn float_formats_keep_every_bit(map in maps(numbers())) {
        let folder = tempfile::tempdir()?;
        for name in ["m.npy", "m.npz", "m.pfm", "m.exr"] {
            let path = folder.path().join(name);
            format::write_depth(&path, map.view())?;
            let read = format::read_values(&path, &ReadOptions::default())?;
            prop_assert_eq!(read.mapv(f32::to_bits), map.mapv(f32::to_bits), "{}", name);
        }
    }

    #[test]
    fn png16_is_within_half_a_step(map in maps(0.0_f32..60.0), scale in 1.0_f64..1000.0) {
        let (_folder, path) = place("m.png");
        format::write_png16(&path, map.view(), scale)?;
        let options = ReadOptions { png_scale: Some(scale), ..ReadOptions::default() };
        let read = format::read_values(&path, &options)?;
        for (&a, &b) in map.iter().zip(&read) {
            let error = (f64::from(a) - f64::from(b)).abs();
            // Depths below half a step become one step: they must not turn into missing pixels.
            let bound = if a > 0.0 && f64::from(a) * scale < 0.5 { 1.0 } else { 0.5 };
            prop_assert!(error <= bound / scale + 1e-5, "{} read as {}", a, b);
            prop_assert_eq!(a > 0.0, b > 0.0);
        }
    }

    #[test]
    fn numpy_agrees_on_npy(map in maps(-1e6_f32..1e6)) {
        let (_folder, path) = place("m.npy");
        format::write_npy(&path, map.view())?;
        prop_assert_eq!(&ndarray_npy::read_npy::<_, Array2<f32>>(&path)?, &map);
        ndarray_npy::write_npy(&path, &map.mapv(f64::from))?;
        prop_assert_eq!(&format::read_values(&path, &ReadOptions::default())?, &map);
        // Transposed arrays are stored in Fortran order.
        ndarray_npy::write_npy(&path, &map.t())?;
        prop_assert_eq!(&format::read_values(&path, &ReadOptions::default())?, &map.t());
        ndarray_npy::write_npy(&path, &map.mapv(|v| v.abs() as u16))?;
        let thousandths = map.mapv(|v| (f64::from(v.abs() as u16) / 1000.0) as f32);
        prop_assert_eq!(&format::read_values(&path, &ReadOptions::default())?, &thousandths);
    }

    #[test]
    fn deflated_npz_of_any_content_is_read(h in 1_usize..60, w in 1_usize..60, levels in 1_u32..5000, seed: u32) {
        let mut state = seed;
        let map = Array2::from_shape_fn((h, w), |_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            ((state >> 8) % levels) as f32
        });
        prop_assert_eq!(format::decode(Format::Npz, &deflated(&map), &ReadOptions::default())?, map);
    }

    #[test]
    fn parsers_never_panic_on_noise(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        for (format, _) in samples() {
            prop_assert!(format::decode(format, &bytes, &ReadOptions::default()).is_err());
        }
        let _ = photo::decode_image(&bytes);
    }

    #[test]
    fn truncated_files_are_errors(cut: Index) {
        for (format, bytes) in samples() {
            let cut = cut.index(bytes.len());
            let parsed = format::decode(format, &bytes[..cut], &ReadOptions::default());
            // The last 12 bytes of a PNG hold no pixels.
            prop_assert!(parsed.is_err() || (format == Format::Png && cut + 12 >= bytes.len()), "{:?} cut at {}", format, cut);
        }
    }

    #[test]
    fn damaged_files_never_panic(at: Index, value: u8, more: Index, other: u8) {
        for (format, mut bytes) in samples() {
            let (first, second) = (at.index(bytes.len()), more.index(bytes.len()));
            bytes[first] = value;
            bytes[second] = other;
            let _ = format::decode(format, &bytes, &ReadOptions::default());
            let _ = photo::decode_image(&bytes);
        }
    }
}

#[test]
fn absurd_headers_take_no_memory() {
    assert!(format::decode(Format::Pfm, b"Pf\n10000 10000\n-1\n", &ReadOptions::default()).is_err());
    // The data window of an EXR, blown up in place.
    let (_, mut exr) = samples().into_iter().find(|(f, _)| *f == Format::Exr).unwrap();
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = exr.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4 + 8;
        exr[at..at + 8].copy_from_slice(&[0xff, 0xff, 0, 0, 0xff, 0xff, 0, 0]);
    }
    assert!(format::decode(Format::Exr, &exr, &ReadOptions::default()).is_err());
}

#[test]
fn a_pfm_is_read_bottom_up_in_both_byte_orders_and_with_windows_line_ends() {
    let big = [&b"Pf\n1 2\n1.0\n"[..], &2.0_f32.to_be_bytes(), &1.0_f32.to_be_bytes()].concat();
    let windows = [&b"Pf\r\n1 2\r\n-1.0\r\n"[..], &2.0_f32.to_le_bytes(), &1.0_f32.to_le_bytes()].concat();
    for file in [big, windows] {
        let map = format::decode(Format::Pfm, &file, &ReadOptions::default()).unwrap();
        assert_eq!(map, array![[1.0], [2.0]]);
    }
}

#[test]
fn the_first_nan_is_named_where_values_are_read() {
    let (_folder, path) = place("nan.pfm");
    std::fs::write(&path, b"Pf\n1 1\n-1\n\x00\x00\xc0\x7f").unwrap();
    let message = format::read_values(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(message.contains("nan.pfm: NaN at row 0, column 0"), "{message}");
}

#[test]
fn arrays_and_channels_are_chosen_by_name() {
    let (_folder, path) = place("two.npz");
    let (a, b) = (array![[1.0_f32]], array![[2.0_f32]]);
    let read = |name: Option<&str>| {
        format::read_values(&path, &ReadOptions { npz_array: name.map(Into::into), ..ReadOptions::default() })
    };
    format::write_npz(&path, &[("a", a.view()), ("b", b.view())]).unwrap();
    assert_eq!(read(Some("b")).unwrap(), b);
    assert!(read(None).unwrap_err().to_string().contains(r#"["a", "b"]"#));
    assert!(read(Some("c")).unwrap_err().to_string().contains(r#"no array "c""#));
    format::write_npz(&path, &[("a", a.view()), ("depth", b.view())]).unwrap();
    assert_eq!(read(None).unwrap(), b);
    assert!(format::write_npz(&path, &[("a", a.view()), ("a", b.view())]).is_err());
}

#[test]
fn nothing_is_left_behind_by_a_failed_write() {
    let (folder, path) = place("m.png");
    format::write_png16(&path, array![[1.0]].view(), 1000.0).unwrap();
    let before = std::fs::read(&path).unwrap();
    let refused = format::write_png16(&path, array![[66.0]].view(), 1000.0).unwrap_err().to_string();
    assert!(refused.contains("66"), "{refused}");
    assert!(format::write_png16(&path, array![[f32::NAN]].view(), 1000.0).is_err());
    assert!(format::write_npy(folder.path().join("absent/m.npy"), array![[1.0]].view()).is_err());
    assert_eq!(std::fs::read(&path).unwrap(), before);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_file_prior_has_the_image_size_or_says_both() {
    let (_folder, path) = place("d.npy");
    format::write_npy(&path, array![[0.0_f32, -1.0, 2000.0]].view()).unwrap();
    let image = mde_prior::ndarray::Array3::zeros((1, 3, 3));

    let thousandths = ReadOptions { float_scale: 1000.0, ..ReadOptions::default() };
    let depth =
        FilePrior::open(&path, DepthKind::Metric, &thousandths).unwrap().predict(image.view()).unwrap();
    assert_eq!(depth.map, array![[0.0, 0.0, 2.0]]);
    assert_eq!(depth.valid, array![[false, false, true]]);
    let prior = FilePrior::open(&path, DepthKind::AffineDisparity, &ReadOptions::default()).unwrap();
    assert!(prior.prior().valid.iter().all(|&v| v));

    let other = mde_prior::ndarray::Array3::zeros((4, 5, 3));
    let message = prior.predict(other.view()).unwrap_err().to_string();
    assert!(message.contains("3x1") && message.contains("5x4"), "{message}");
}

#[test]
fn a_depth_png_is_read_by_the_scale_in_its_metadata() {
    let (_folder, path) = place("m.png");
    let map = array![[0.0, 1.25], [2.5, 13.0], [13.2, f32::INFINITY]];
    let read = |options: &ReadOptions| format::read_values(&path, options).unwrap();
    assert_eq!(format::write_depth_png(&path, map.view(), "m", 5000.0).unwrap(), 1);
    // What does not fit is missing, as what has no depth.
    assert_eq!(read(&ReadOptions::default()), array![[0.0, 1.25], [2.5, 13.0], [0.0, 0.0]]);
    let stated = ReadOptions { png_scale: Some(1000.0), ..ReadOptions::default() };
    assert_eq!(read(&stated)[(0, 1)], 6.25);
    let expected = format::PngContent::Depth { unit: "m".to_owned(), scale: 5000.0 };
    assert_eq!(format::png_content(&path).unwrap(), Some(expected));
    format::write_png16(&path, array![[1.5]].view(), 1000.0).unwrap();
    assert_eq!((format::png_content(&path).unwrap(), read(&ReadOptions::default())), (None, array![[1.5]]));
    let unprintable = format::write_depth_png(&path, map.view(), "m\u{b2}", 1000.0).unwrap_err().to_string();
    assert!(unprintable.contains("ASCII"), "{unprintable}");
}

#[test]
fn a_scale_that_is_none_and_a_confidence_are_refused_as_depth() {
    let (_folder, path) = place("m.png");
    let refused = || format::read_depth(&path, &ReadOptions::default()).unwrap_err().to_string();
    format::write_depth_png(&path, array![[1.0]].view(), "m", 1000.0).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(16).position(|part| part == b"Depth-Scale\x001000").unwrap();
    std::fs::write(&path, [&bytes[..at + 12], b"-100", &bytes[at + 16..]].concat()).unwrap();
    assert!(refused().contains("Depth-Scale"), "{}", refused());
    format::write_confidence_png(&path, array![[0.0, 0.5, 1.0]].view(), "1 - x").unwrap();
    assert!(refused().contains("a confidence, not a depth"), "{}", refused());
    assert_eq!(format::png_content(&path).unwrap(), Some(format::PngContent::Confidence));
    let high = format::write_confidence_png(&path, array![[1.5]].view(), "x").unwrap_err().to_string();
    assert!(high.contains("1.5 at row 0, column 0"), "{high}");
}
