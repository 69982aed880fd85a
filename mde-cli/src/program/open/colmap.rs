//! Matches of photographs by the program COLMAP.

use crate::program::interrupt;
use crate::program::progress::Progress;
use anyhow::{Context, Result, bail, ensure};
use crate::several::Photograph;
use mde_mvs::poses::{GivenMatches, Match};
use mde_prior::photo::write_image;
use nalgebra::Point2;
use rusqlite::{Connection, OpenFlags, Row};
use std::collections::HashMap;
use std::io::ErrorKind;
use std::path::Path;
use std::process::Command;

const PROGRAM: &str = "colmap";
/// COLMAP's `kMaxNumImages`: a pair's identifier is that of its first image times this, plus that of the second.
const MOST_IMAGES: i64 = 2_147_483_647;
/// A point has 2, 4 (scale, angle) or 6 numbers.
const POINT_LENGTHS: [u32; 3] = [2, 4, 6];

/// COLMAP's features of the photographs and the matches of all pairs of them, before any geometry.
pub(crate) fn matches(photographs: &[Photograph], progress: &mut Progress) -> Result<GivenMatches> {
    progress.next("colmap: features and matches");
    let folder = tempfile::tempdir().context("can't make a folder for colmap's photographs")?;
    let (images, database) = (folder.path().join("images"), folder.path().join("database.db"));
    std::fs::create_dir(&images).with_context(|| format!("{}: can't be made", images.display()))?;
    for (index, photograph) in photographs.iter().enumerate() {
        write_image(images.join(name(index)), photograph.image.view())?;
    }
    let threads = rayon::current_num_threads().to_string();
    let extract = ["--image_path".as_ref(), images.as_os_str()];
    for (command, options, more) in [
        ("feature_extractor", ["FeatureExtraction", "SiftExtraction"], extract.as_slice()),
        ("exhaustive_matcher", ["FeatureMatching", "SiftMatching"], &[]),
    ] {
        // Its options are named by the first in version 4, by the second before.
        let help = run(Command::new(PROGRAM).args([command, "--help"]))?;
        let group = options.iter().find(|group| help.contains(&format!("--{group}.use_gpu")));
        let mut call = Command::new(PROGRAM);
        call.arg(command).arg("--database_path").arg(&database).args(more);
        if let Some(group) = group {
            call.args([&format!("--{group}.use_gpu"), "0", &format!("--{group}.num_threads"), &threads]);
        }
        run(&mut call)?;
    }
    read(&database, photographs.len()).context("--matches colmap: its database is not as expected")
}

fn name(index: usize) -> String {
    format!("{index}.png")
}

/// What the program printed.
fn run(command: &mut Command) -> Result<String> {
    // Its features need no screen, but without one its Qt needs this.
    let output =
        command.env("QT_QPA_PLATFORM", "offscreen").output().map_err(|error| match error.kind() {
            ErrorKind::NotFound => anyhow::anyhow!(
                "--matches colmap: no program colmap on the PATH; install it, or leave --matches out"
            ),
            _ => anyhow::anyhow!("--matches colmap: it can't be started ({error}); check the installation"),
        })?;
    if interrupt::requested() {
        bail!(crate::error::Error::Interrupted);
    }
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let printed = text(&output.stdout) + &text(&output.stderr);
    let last = printed.lines().rev().map(str::trim).find(|line| !line.is_empty()).unwrap_or_default();
    let status = output.status;
    ensure!(status.success(), "--matches colmap: it failed ({status}): {last}; leave --matches out");
    Ok(printed)
}

/// The points and matches in COLMAP's database of photographs `0.png`, `1.png`, ...
fn read(database: &Path, count: usize) -> Result<GivenMatches> {
    let database = Connection::open_with_flags(database, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
    let indices: HashMap<String, usize> = (0..count).map(|index| (name(index), index)).collect();
    let mut places = HashMap::new();
    for (id, name) in rows(&database, "SELECT image_id, name FROM images", |row| {
        Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?))
    })? {
        places.extend(indices.get(&name).map(|index| (id, *index)));
    }
    let mut matches = GivenMatches { points: vec![Vec::new(); count], pairs: Vec::new() };
    for (id, columns, data) in
        rows(&database, "SELECT image_id, cols, data FROM keypoints WHERE rows > 0", columns_of)?
    {
        let index =
            *places.get(&id).with_context(|| format!("keypoints of image {id}, which is not there"))?;
        ensure!(POINT_LENGTHS.contains(&columns), "keypoints of {columns} columns");
        let columns = columns as usize;
        let point = |values: &[f32]| {
            // COLMAP's pixel centres are at halves.
            Point2::new(f64::from(values[0]) - 0.5, f64::from(values[1]) - 0.5)
        };
        matches.points[index] =
            numbers(&data, f32::from_le_bytes)?.chunks_exact(columns).map(point).collect();
    }
    for (pair, columns, data) in rows(
        &database,
        "SELECT pair_id, cols, data FROM matches WHERE rows > 0 ORDER BY pair_id",
        columns_of,
    )? {
        ensure!(columns == 2, "matches of {columns} columns");
        let ids = [pair / MOST_IMAGES, pair % MOST_IMAGES];
        let place = |id| {
            places.get(&id).copied().with_context(|| format!("matches of image {id}, which is not there"))
        };
        let found = numbers(&data, u32::from_le_bytes)?;
        let found = found.chunks_exact(2).map(|m| Match { first: m[0] as usize, second: m[1] as usize });
        matches.pairs.push(([place(ids[0])?, place(ids[1])?], found.collect()));
    }
    Ok(matches)
}

fn rows<T>(
    database: &Connection,
    query: &str,
    read: impl FnMut(&Row<'_>) -> rusqlite::Result<T>,
) -> rusqlite::Result<Vec<T>> {
    database.prepare(query)?.query_map([], read)?.collect()
}

/// An identifier, a number of columns, and an array.
fn columns_of(row: &Row<'_>) -> rusqlite::Result<(i64, u32, Vec<u8>)> {
    Ok((row.get(0)?, row.get(1)?, row.get(2)?))
}

fn numbers<T>(bytes: &[u8], number: fn([u8; 4]) -> T) -> Result<Vec<T>> {
    let (words, rest) = bytes.as_chunks::<4>();
    ensure!(rest.is_empty(), "an array of {} bytes", bytes.len());
    Ok(words.iter().map(|word| number(*word)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A database with COLMAP's tables, its second photograph entered first.
    fn database(place: &Path, points: &str) {
        let f32s = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let u32s = |values: &[u32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let database = Connection::open(place).unwrap();
        database
            .execute_batch(&format!(
                "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);
                 CREATE TABLE {points} (image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
                 CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
                 INSERT INTO images VALUES (1, '1.png', 1), (2, '0.png', 1), (3, '2.png', 1);"
            ))
            .unwrap();
        let row = format!("INSERT INTO {points} VALUES (?, ?, ?, ?)");
        database.execute(&row, (1, 2, 4, f32s(&[10.5, 20.5, 1.0, 0.0, 11.0, 21.0, 1.0, 0.0]))).unwrap();
        database.execute(&row, (2, 1, 4, f32s(&[1.5, 2.5, 1.0, 0.0]))).unwrap();
        database.execute(&row, (3, 0, 4, None::<Vec<u8>>)).unwrap();
        let pair = |first: i64, second: i64| first * MOST_IMAGES + second;
        let add = "INSERT INTO matches VALUES (?, ?, ?, ?)";
        database.execute(add, (pair(1, 2), 1, 2, u32s(&[1, 0]))).unwrap();
        database.execute(add, (pair(1, 3), 0, 2, None::<Vec<u8>>)).unwrap();
    }

    #[test]
    fn points_and_matches_are_read_with_centres_at_integers() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("database.db");
        database(&place, "keypoints");
        let expected = GivenMatches {
            points: vec![
                vec![Point2::new(1.0, 2.0)],
                vec![Point2::new(10.0, 20.0), Point2::new(10.5, 20.5)],
                Vec::new(),
            ],
            pairs: vec![([1, 0], vec![Match { first: 1, second: 0 }])],
        };
        assert_eq!(read(&place, 3).unwrap(), expected);
        // Of a photograph that the database should not have.
        assert!(read(&place, 1).unwrap_err().to_string().contains("image 1"));
    }

    #[test]
    fn a_database_of_other_tables_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("database.db");
        database(&place, "points");
        assert!(read(&place, 3).unwrap_err().to_string().contains("keypoints"));
        assert!(read(&folder.path().join("none.db"), 3).is_err());
    }
}
