//! Files: written under temporary names, all renamed at the end or none.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use farfield_radiosity::Surfel;

use crate::report::Report;

/// A failure to write, with the file or folder it concerns.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub(crate) struct OutputError {
    path: PathBuf,
    source: io::Error,
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

    /// Writes surfels as a point cloud with normals, areas and colours.
    pub(crate) fn ply(
        &mut self,
        name: &'static str,
        surfels: &[Surfel],
        codes: &[[u8; 3]],
    ) -> Result<(), OutputError> {
        self.write(name, |file| {
            writeln!(file, "ply\nformat ascii 1.0\nelement vertex {}", surfels.len())?;
            for property in ["x", "y", "z", "nx", "ny", "nz", "area"] {
                writeln!(file, "property float {property}")?;
            }
            for property in ["red", "green", "blue"] {
                writeln!(file, "property uchar {property}")?;
            }
            writeln!(file, "end_header")?;
            for (surfel, [r, g, b]) in surfels.iter().zip(codes) {
                let (p, n) = (surfel.position.as_vec3(), surfel.normal.as_vec3());
                write!(file, "{} {} {} {} {} {} ", p.x, p.y, p.z, n.x, n.y, n.z)?;
                writeln!(file, "{} {r} {g} {b}", surfel.area as f32)?;
            }
            Ok(())
        })
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
    use glam::DVec3;

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
        let surfel = Surfel { position: DVec3::X, normal: DVec3::Y, area: 2.0, face: 0 };
        let write = |output: &mut Output| output.ply("s.ply", &[surfel], &[[1, 2, 3]]);

        let mut output = Output::new(&folder).expect("writable");
        write(&mut output).expect("written");
        drop(output);
        assert!(names(&folder).is_empty());

        let mut output = Output::new(&folder).expect("writable");
        write(&mut output).expect("written");
        output.publish().expect("renamed");
        assert_eq!(names(&folder), ["s.ply"]);
        let ply = fs::read_to_string(folder.join("s.ply")).expect("readable");
        assert!(ply.starts_with("ply\n") && ply.ends_with("\n1 0 0 0 1 0 2 1 2 3\n"), "{ply}");
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
