//! Files: written under temporary names, all renamed at the end or none.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage};

use crate::fields::Fields;
use crate::mesh::Mesh;
use crate::report::Report;
use crate::tone::Rgb;
use crate::{ply_mesh, table, vtu};

/// A failure to write, with the file or folder it concerns.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub(crate) struct OutputError {
    path: PathBuf,
    source: io::Error,
}

impl OutputError {
    /// What went wrong with the file at `path`.
    pub(crate) fn new(path: &Path, source: io::Error) -> Self {
        Self { path: path.to_owned(), source }
    }
}

/// Files of one folder that appear together: [`publish`](Self::publish) gives them their names, and
/// without it none is left behind.
#[derive(Debug)]
pub(crate) struct Output {
    folder: PathBuf,
    /// The names of the files written so far.
    pending: Vec<&'static str>,
}

impl Output {
    /// Makes the folder if need be and checks that files can be written there.
    pub(crate) fn new(folder: &Path) -> Result<Self, OutputError> {
        let failed = |source| OutputError { path: folder.to_owned(), source };
        fs::create_dir_all(folder).map_err(failed)?;
        let mut output = Self { folder: folder.to_owned(), pending: Vec::new() };
        output.write("probe", |file| file.write_all(&[0])).map_err(|e| failed(e.source))?;
        output.discard();
        Ok(output)
    }

    /// Writes a square picture of sRGB codes, row by row from the upper left corner.
    pub(crate) fn png(
        &mut self,
        name: &'static str,
        size: usize,
        codes: &[[u8; 3]],
    ) -> Result<(), OutputError> {
        let edge = size as u32;
        self.write(name, |file| {
            let mut encoder = png::Encoder::new(file, edge, edge);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
            let mut writer = encoder.write_header()?;
            writer.write_image_data(codes.as_flattened())?;
            Ok(writer.finish()?)
        })
    }

    /// Writes a square picture of radiances in linear RGB, row by row from the upper left corner, as
    /// OpenEXR in single precision.
    pub(crate) fn exr(
        &mut self,
        name: &'static str,
        size: usize,
        radiances: &[Rgb],
    ) -> Result<(), OutputError> {
        self.write(name, |file| {
            if radiances.len() != size * size {
                return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a square picture"));
            }
            let channels = SpecificChannels::rgb(|place: Vec2<usize>| {
                let [r, g, b] = radiances[place.y() * size + place.x()].map(|band| band as f32);
                (r, g, b)
            });
            let image = Image::from_channels((size, size), channels);
            image.write().non_parallel().to_buffered(file).map_err(io::Error::other)
        })
    }

    /// Writes a mesh with what is known of its elements, and their colours as sRGB codes, as PLY.
    pub(crate) fn ply_mesh(
        &mut self,
        name: &'static str,
        mesh: &Mesh,
        fields: &Fields,
        codes: &[[u8; 3]],
    ) -> Result<(), OutputError> {
        self.write(name, |file| ply_mesh::write(file, mesh, fields, codes))
    }

    /// Writes a mesh with what is known of its elements as a VTK unstructured grid.
    pub(crate) fn vtu(
        &mut self,
        name: &'static str,
        mesh: &Mesh,
        fields: &Fields,
    ) -> Result<(), OutputError> {
        self.write(name, |file| vtu::write(file, mesh, fields))
    }

    /// Writes a line of numbers for each element as CSV, below a line with their names.
    pub(crate) fn csv(
        &mut self,
        name: &'static str,
        mesh: &Mesh,
        fields: &Fields,
    ) -> Result<(), OutputError> {
        self.write(name, |file| table::csv(file, mesh, fields))
    }

    /// Writes the numbers of a CSV file as a matrix with a row for each element, as NPY.
    pub(crate) fn npy(
        &mut self,
        name: &'static str,
        mesh: &Mesh,
        fields: &Fields,
    ) -> Result<(), OutputError> {
        self.write(name, |file| table::npy(file, mesh, fields))
    }

    /// Writes a report as JSON.
    pub(crate) fn json(&mut self, name: &'static str, report: &Report) -> Result<(), OutputError> {
        self.write(name, |file| {
            serde_json::to_writer_pretty(&mut *file, report)?;
            writeln!(file)
        })
    }

    /// Gives all files their names, replacing earlier ones.
    pub(crate) fn publish(mut self) -> Result<(), OutputError> {
        while let Some(name) = self.pending.last() {
            let path = self.folder.join(name);
            fs::rename(self.temporary(name), &path)
                .map_err(|source| OutputError { path, source })?;
            self.pending.pop();
        }
        Ok(())
    }

    fn write(
        &mut self,
        name: &'static str,
        content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), OutputError> {
        self.pending.push(name);
        let path = self.temporary(name);
        let written = File::create(&path).and_then(|file| {
            let mut file = BufWriter::new(file);
            content(&mut file)?;
            file.flush()
        });
        written.map_err(|source| OutputError { path, source })
    }

    fn temporary(&self, name: &str) -> PathBuf {
        self.folder.join(format!(".{name}.{}.partial", std::process::id()))
    }

    /// Removes what was written. What can't be removed stays under its temporary name.
    fn discard(&mut self) {
        for name in std::mem::take(&mut self.pending) {
            drop(fs::remove_file(self.temporary(name)));
        }
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        self.discard();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(test: &str) -> PathBuf {
        std::env::temp_dir().join(format!("farfield-{test}-{}", std::process::id()))
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("folder");
        let name = |entry: io::Result<fs::DirEntry>| entry.expect("entry").file_name();
        entries.map(|entry| name(entry).into_string().expect("UTF-8")).collect()
    }

    #[test]
    fn files_appear_only_when_published() {
        let folder = folder("publish");
        let write = |output: &mut Output| output.png("s.png", 1, &[[1, 2, 3]]);

        let mut output = Output::new(&folder).expect("writable");
        write(&mut output).expect("written");
        drop(output);
        assert!(names(&folder).is_empty());

        let mut output = Output::new(&folder).expect("writable");
        write(&mut output).expect("written");
        output.publish().expect("renamed");
        assert_eq!(names(&folder), ["s.png"]);
        let png = fs::read(folder.join("s.png")).expect("readable");
        assert_eq!(&png[1..4], b"PNG");
        fs::remove_dir_all(&folder).expect("removable");
    }

    #[test]
    fn pictures_keep_every_radiance() {
        let folder = folder("exr");
        let radiance = |k: usize| [0.1 * k as f64, -3.5e7, 1e-9];
        let radiances: Vec<Rgb> = (0..9).map(radiance).collect();
        let mut output = Output::new(&folder).expect("writable");
        output.exr("p.exr", 3, &radiances).expect("written");
        let error = output.exr("q.exr", 2, &radiances).expect_err("nine pixels");
        assert!(error.to_string().contains("square"), "{error}");
        drop(output);
        let mut output = Output::new(&folder).expect("writable");
        output.exr("p.exr", 3, &radiances).expect("written");
        output.publish().expect("renamed");
        let image = exr::prelude::read_first_rgba_layer_from_file(
            folder.join("p.exr"),
            |size, _| vec![[0.0f32; 3]; size.area()],
            |pixels, place, (r, g, b, _): (f32, f32, f32, f32)| {
                pixels[place.y() * 3 + place.x()] = [r, g, b];
            },
        );
        let found = image.expect("readable").layer_data.channel_data.pixels;
        let expected: Vec<_> = radiances.iter().map(|rgb| rgb.map(|band| band as f32)).collect();
        assert_eq!(found, expected);
        fs::remove_dir_all(&folder).expect("removable");
    }

    #[test]
    fn every_format_of_a_mesh_is_written_in_full_or_not_at_all() {
        let folder = folder("mesh");
        let (mesh, fields) = crate::fields::tests::sample(true);
        let mut output = Output::new(&folder).expect("writable");
        let codes = [[1, 2, 3]; 3];
        output.ply_mesh("m.ply", &mesh, &fields, &codes).expect("written");
        output.vtu("m.vtu", &mesh, &fields).expect("written");
        output.csv("m.csv", &mesh, &fields).expect("written");
        output.npy("m.npy", &mesh, &fields).expect("written");
        output.publish().expect("renamed");
        let mut found = names(&folder);
        found.sort_unstable();
        assert_eq!(found, ["m.csv", "m.npy", "m.ply", "m.vtu"]);
        let mut output = Output::new(&folder.join("none")).expect("writable");
        let short = Fields { row_sums: Vec::new(), ..fields };
        assert!(output.csv("m.csv", &mesh, &short).is_err());
        drop(output);
        assert!(names(&folder.join("none")).is_empty());
        fs::remove_dir_all(&folder).expect("removable");
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_named() {
        let file = folder("file");
        fs::write(&file, "in the way").expect("writable");
        let error = Output::new(&file.join("below")).expect_err("a file is in the way");
        assert!(error.to_string().contains("below"), "{error}");
        fs::remove_file(&file).expect("removable");
    }
}
