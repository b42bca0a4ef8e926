//! Files: written under temporary names, all renamed at the end or none.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::cutting::fields::Fields;
use crate::cutting::mesh::Mesh;
use crate::output::{ply, table, vtu};

/// A failure to write, with the file or folder it concerns.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct OutputError {
    path: PathBuf,
    source: io::Error,
}

impl OutputError {
    /// What went wrong with the file at `path`.
    pub fn new(path: &Path, source: io::Error) -> Self {
        Self { path: path.to_owned(), source }
    }
}

/// Files that appear in a folder together or not at all. They are written under temporary names, until
/// [`publish`](Self::publish) gives them their own; if it is never called, they are removed.
#[derive(Debug)]
pub struct Output {
    folder: PathBuf,
    /// The names of the files written so far.
    pending: Vec<&'static str>,
}

impl Output {
    /// Makes the folder if need be, and checks that files can be written there.
    ///
    /// # Errors
    /// Those of the system, with the folder.
    pub fn new(folder: &Path) -> Result<Self, OutputError> {
        let failed = |source| OutputError { path: folder.to_owned(), source };
        fs::create_dir_all(folder).map_err(failed)?;
        let mut output = Self { folder: folder.to_owned(), pending: Vec::new() };
        output.write("probe", |file| file.write_all(&[0])).map_err(|e| failed(e.source))?;
        output.discard();
        Ok(output)
    }

    /// Writes a square picture of sRGB codes, row by row from the upper left corner.
    pub fn png(
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

    /// Writes a mesh with what is known of its elements, and their colours as sRGB codes, as PLY.
    pub fn ply_mesh(
        &mut self,
        name: &'static str,
        mesh: &Mesh,
        fields: &Fields,
        codes: &[[u8; 3]],
    ) -> Result<(), OutputError> {
        self.write(name, |file| ply::write(file, mesh, fields, codes))
    }

    /// Writes a mesh with what is known of its elements as a VTK unstructured grid.
    pub fn vtu(
        &mut self,
        name: &'static str,
        mesh: &Mesh,
        fields: &Fields,
    ) -> Result<(), OutputError> {
        self.write(name, |file| vtu::write(file, mesh, fields))
    }

    /// Writes a line of numbers for each element as CSV, below a line with their names.
    pub fn csv(
        &mut self,
        name: &'static str,
        mesh: &Mesh,
        fields: &Fields,
    ) -> Result<(), OutputError> {
        self.write(name, |file| table::csv(file, mesh, fields))
    }

    /// Writes any other file.
    ///
    /// # Errors
    /// Those of `content`, and those of the system, with the file that they concern.
    pub fn write(
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

    /// Gives all files their names, replacing earlier ones.
    pub fn publish(mut self) -> Result<(), OutputError> {
        while let Some(name) = self.pending.last() {
            let path = self.folder.join(name);
            fs::rename(self.temporary(name), &path)
                .map_err(|source| OutputError { path, source })?;
            self.pending.pop();
        }
        Ok(())
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
    fn every_format_of_a_mesh_is_written_in_full_or_not_at_all() {
        let folder = folder("mesh");
        let (mesh, fields) = crate::cutting::fields::tests::sample(true);
        let mut output = Output::new(&folder).expect("writable");
        let codes = [[1, 2, 3]; 3];
        output.ply_mesh("m.ply", &mesh, &fields, &codes).expect("written");
        output.vtu("m.vtu", &mesh, &fields).expect("written");
        output.csv("m.csv", &mesh, &fields).expect("written");
        output.publish().expect("renamed");
        let mut found = names(&folder);
        found.sort_unstable();
        assert_eq!(found, ["m.csv", "m.ply", "m.vtu"]);
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
