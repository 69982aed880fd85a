//! Photographs.

use crate::{fixture, place};
use std::io::Cursor;

use image::{DynamicImage, ImageFormat};
use mde_prior::ndarray::{Array3, array};
use mde_prior::photo::{decode_image, encode_rgb_png, image_size, read_image, write_image, write_rgb_png};
use proptest::prelude::*;

fn encode(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// A JPEG with an EXIF segment: orientation, and the 35 mm focal length in the EXIF directory.
fn jpeg_with_exif(image: &DynamicImage, orientation: u16, focal: u16) -> Vec<u8> {
    let jpeg = encode(image, ImageFormat::Jpeg);
    let entry = |tag: u16, kind: u16, value: u32| {
        [&tag.to_be_bytes()[..], &kind.to_be_bytes(), &1_u32.to_be_bytes(), &value.to_be_bytes()].concat()
    };
    // The first two of its four bytes.
    let short = |tag: u16, value: u16| entry(tag, 3, u32::from(value) << 16);
    let mut tiff = b"MM\0\x2a\0\0\0\x08\0\x02".to_vec();
    tiff.extend(short(0x0112, orientation));
    tiff.extend(entry(0x8769, 4, 38));
    tiff.extend([0, 0, 0, 0, 0, 1]);
    tiff.extend(short(0xa405, focal));
    tiff.extend([0; 4]);
    let length = (tiff.len() as u16 + 8).to_be_bytes();
    [&jpeg[..2], &[0xff, 0xe1], &length, b"Exif\0\0", &tiff, &jpeg[2..]].concat()
}

proptest! {
    #[test]
    fn eight_bits_round_trip(values in proptest::collection::vec(any::<u8>(), 3 * 3 * 5)) {
        let (_folder, path) = place("a.png");
        let pixels = Array3::from_shape_vec((3, 5, 3), values)?;
        write_rgb_png(&path, pixels.view())?;
        let read = read_image(&path)?.pixels;
        let before = encode_rgb_png(pixels.view())?;
        prop_assert_eq!(&std::fs::read(&path)?, &before);
        prop_assert_eq!(read.mapv(|v| (v * 255.0).round() as u8), pixels);
        write_image(&path, read.view())?;
        prop_assert_eq!(std::fs::read(&path)?, before);
    }

    #[test]
    fn truncated_photographs_never_panic(cut: prop::sample::Index) {
        let image = DynamicImage::ImageRgb8(image::RgbImage::from_fn(16, 9, |x, y| image::Rgb([x as u8, y as u8, 3])));
        for bytes in [jpeg_with_exif(&image, 6, 28), encode(&image, ImageFormat::Tiff), encode(&image, ImageFormat::WebP)] {
            let _ = decode_image(&bytes[..cut.index(bytes.len())]);
        }
    }
}

#[test]
fn every_kind_of_pixel_becomes_three_channels_in_the_unit_interval() {
    let expected = array![[[0.2_f32, 0.2, 0.2], [1.0, 1.0, 1.0]]];
    let grey8 = DynamicImage::ImageLuma8(image::ImageBuffer::from_raw(2, 1, vec![51, 255]).unwrap());
    let transparent = image::ImageBuffer::from_raw(2, 1, vec![51, 9, 255, 0]).unwrap();
    let images = [
        (grey8.clone(), ImageFormat::Png),
        (DynamicImage::ImageLuma16(grey8.to_luma16()), ImageFormat::Png),
        (DynamicImage::ImageLumaA8(transparent), ImageFormat::Png),
        (DynamicImage::ImageRgba16(grey8.to_rgba16()), ImageFormat::Png),
        (DynamicImage::ImageRgb16(grey8.to_rgb16()), ImageFormat::Tiff),
        (DynamicImage::ImageRgb8(grey8.to_rgb8()), ImageFormat::Bmp),
        (DynamicImage::ImageRgb8(grey8.to_rgb8()), ImageFormat::WebP),
    ];
    for (image, format) in images {
        let photo = decode_image(&encode(&image, format)).unwrap();
        assert_eq!(photo.pixels.dim(), (1, 2, 3));
        for (a, b) in photo.pixels.iter().zip(&expected) {
            assert!((a - b).abs() < 1e-4, "{format:?} {:?}: {a} instead of {b}", image.color());
        }
        assert_eq!(photo.focal_35mm, None);
    }
}

#[test]
fn exif_turns_the_picture_and_gives_the_focal_length() {
    // Bright on the left; orientation 6 means "turn clockwise to look at it", so the left goes to the top.
    let image = DynamicImage::ImageRgb8(image::RgbImage::from_fn(32, 16, |x, _| {
        image::Rgb([if x < 16 { 250 } else { 5 }; 3])
    }));
    let photo = decode_image(&jpeg_with_exif(&image, 6, 28)).unwrap();
    assert_eq!(photo.pixels.dim(), (32, 16, 3));
    assert!(photo.pixels[[2, 8, 0]] > 0.9 && photo.pixels[[29, 8, 0]] < 0.1);
    assert_eq!(photo.focal_35mm, Some(28.0));
    assert_eq!(decode_image(&jpeg_with_exif(&image, 1, 0)).unwrap().focal_35mm, None);
}

/// JPEGs of the same picture: baseline, with other sampling, with restart markers, progressive, grey, of four channels.
#[test]
fn whole_jpegs_have_the_pixels_of_image_and_cut_ones_are_refused() {
    let files = std::fs::read_dir(fixture("jpeg")).unwrap();
    let files: Vec<_> = files.map(|file| std::fs::read(file.unwrap().path()).unwrap()).collect();
    assert_eq!(files.len(), 8);
    for bytes in files {
        let expected = image::load_from_memory(&bytes).unwrap().into_rgb32f().into_raw();
        assert_eq!(decode_image(&bytes).unwrap().pixels.into_raw_vec_and_offset().0, expected);
        let begin = bytes.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap() + 20;
        for share in [0.05, 0.3, 0.6, 0.9, 0.97] {
            let cut = begin + ((bytes.len() - begin) as f64 * share) as usize;
            let message = decode_image(&bytes[..cut]).unwrap_err().to_string();
            assert!(message.contains("truncated"), "cut at {share}: {message}");
        }
    }
}

#[test]
fn what_is_no_picture_is_not_written() {
    let (_folder, path) = place("a.png");
    let refused = write_rgb_png(&path, Array3::zeros((2, 2, 4)).view()).unwrap_err().to_string();
    assert!(refused.contains("[2, 2, 4]"), "{refused}");
    assert!(write_image(&path, Array3::from_elem((2, 2, 3), f32::NAN).view()).is_err());
    assert_eq!(image_size(&path), None);
}
