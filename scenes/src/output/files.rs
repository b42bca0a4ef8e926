//! Files: written under temporary names, all renamed at the end or none.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use crate::cutting::fields::Fields;
use crate::cutting::mesh::Mesh;
use crate::output::page::Page;
use crate::output::replacing::{
    EARLIER, PARTIAL, beside, followed, is_same_file, put_back, refuse_folder, replace,
};
use crate::output::{gltf, page, ply, table, vtu};
use crate::pictures::colours::Colours;
use crate::pictures::shading::Shading;
use crate::scene::Scene;

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

/// Files that appear together or not at all. They are written under temporary names, until
/// [`publish`](Self::publish) gives them their own; if it is never called, they are removed.
#[derive(Debug)]
pub struct Output {
    folder: PathBuf,
    /// Where the files written so far belong.
    pending: Vec<PathBuf>,
}

impl Output {
    /// Makes the folder if need be, and checks that files can be written there.
    ///
    /// # Errors
    /// Those of the system, with the folder.
    pub fn new(folder: &Path) -> Result<Self, OutputError> {
        let failed = |source| OutputError { path: folder.to_owned(), source };
        fs::create_dir_all(folder).map_err(failed)?;
        let output = Self { folder: folder.to_owned(), pending: Vec::new() };
        output.check(&folder.join("probe")).map_err(|e| failed(e.source))?;
        Ok(output)
    }

    /// Checks that a file can be written at `path`, and leaves nothing there.
    ///
    /// # Errors
    /// Those of the system, with the path.
    pub fn check(&self, path: &Path) -> Result<(), OutputError> {
        let failed = |source| OutputError { path: path.to_owned(), source };
        refuse_folder(path).map_err(failed)?;
        let probe = beside(&followed(path).map_err(failed)?, PARTIAL);
        let written = fs::write(&probe, [0]);
        drop(fs::remove_file(&probe));
        written.map_err(failed)
    }

    /// Writes a picture of so many columns and rows of sRGB codes, row by row from the upper left corner.
    pub fn png(
        &mut self,
        name: &'static str,
        size: [usize; 2],
        codes: &[[u8; 3]],
    ) -> Result<(), OutputError> {
        self.write(name, |file| write_png(file, size, codes))
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

    /// Writes a mesh with the colours of its radiosities as binary glTF, by the shading of that mesh.
    pub fn glb(
        &mut self,
        name: &'static str,
        scene: &Scene,
        mesh: &Mesh,
        fields: &Fields,
        shading: &Shading,
        colours: &Colours,
    ) -> Result<(), OutputError> {
        self.write(name, |file| gltf::write(file, scene, mesh, fields, shading, colours))
    }

    /// Writes a solution as a page of HTML to walk through, about a hundred bytes for each element.
    pub fn page(&mut self, name: &'static str, page: &Page<'_>) -> Result<(), OutputError> {
        self.write(name, |file| page::write(file, page))
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
        let path = self.folder.join(name);
        self.write_at(&path, content)
    }

    /// Writes a file that need not be in the folder. A symbolic link stays, and the file that it leads to is
    /// replaced. A device or a pipe stays too, and receives the content when the files are published.
    ///
    /// # Errors
    /// Those of [`write`](Self::write), and [`io::ErrorKind::AlreadyExists`] if a file of this name has been written.
    pub fn write_at(
        &mut self,
        path: &Path,
        content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), OutputError> {
        let path = followed(path).map_err(|source| OutputError::new(path, source))?;
        if self.pending.iter().any(|other| is_same_file(other, &path)) {
            let source = io::ErrorKind::AlreadyExists.into();
            return Err(OutputError { path, source });
        }
        let partial = beside(&path, PARTIAL);
        self.pending.push(path);
        let written = File::create(&partial).and_then(|file| {
            let mut file = BufWriter::new(file);
            content(&mut file)?;
            file.into_inner()?.sync_all()
        });
        written.map_err(|source| OutputError { path: partial, source })
    }

    /// Gives all files their names, replacing earlier ones. If that fails for one of them, the earlier
    /// ones are put back.
    ///
    /// # Errors
    /// Those of the system, with the file that they concern.
    pub fn publish(self) -> Result<(), OutputError> {
        let mut done: Vec<&Path> = Vec::new();
        for path in &self.pending {
            if let Err(source) = replace(path) {
                done.iter().for_each(|path| put_back(path));
                return Err(OutputError { path: path.clone(), source });
            }
            done.push(path);
        }
        // What can't be removed stays under its temporary name.
        done.iter().for_each(|path| drop(fs::remove_file(beside(path, EARLIER))));
        Ok(())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // What can't be removed stays under its temporary name.
        self.pending.iter().for_each(|path| drop(fs::remove_file(beside(path, PARTIAL))));
    }
}

/// Writes one file, which appears whole or not at all. Its folder must exist.
///
/// # Errors
/// Those of [`Output::write`].
pub fn write_file(
    path: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), OutputError> {
    let mut output = Output { folder: PathBuf::new(), pending: Vec::new() };
    output.write_at(path, content)?;
    output.publish()
}

/// Writes a picture of so many columns and rows of sRGB codes as PNG.
fn write_png(file: impl Write, size: [usize; 2], codes: &[[u8; 3]]) -> io::Result<()> {
    let [width, height] = size.map(|edge| edge as u32);
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(codes.as_flattened())?;
    Ok(writer.finish()?)
}

/// A picture of so many columns and rows of sRGB codes, row by row from the upper left corner, as a data URI of a PNG.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`] and the like unless there is a code for each pixel.
pub fn png_uri(size: [usize; 2], codes: &[[u8; 3]]) -> io::Result<String> {
    let mut bytes = Vec::new();
    write_png(&mut bytes, size, codes)?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(bytes)))
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
        let write = |output: &mut Output| output.png("s.png", [1, 1], &[[1, 2, 3]]);

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
    fn where_one_file_cannot_be_replaced_all_stay_as_they_were() {
        let folder = folder("replace");
        let mut output = Output::new(&folder).expect("writable");
        let elsewhere = folder.join("sub").join("table");
        assert!(output.check(&elsewhere).is_err() && output.check(&folder).is_err());
        fs::create_dir(folder.join("sub")).expect("made");
        output.check(&elsewhere).expect("writable");
        fs::write(folder.join("first"), "earlier").expect("written");
        let text = |file: &mut BufWriter<File>| file.write_all(b"later");
        output.write("first", text).expect("written");
        output.write_at(&elsewhere, text).expect("written");
        output.write("third", text).expect("written");
        fs::create_dir(folder.join("third")).expect("in the way");
        assert!(output.publish().expect_err("in the way").to_string().contains("third"));
        assert_eq!(fs::read(folder.join("first")).expect("there"), b"earlier");
        assert!(names(&folder.join("sub")).is_empty());
        let mut found = names(&folder);
        found.sort_unstable();
        assert_eq!(found, ["first", "sub", "third"]);
        fs::remove_dir_all(&folder).expect("removable");
    }

    #[test]
    fn two_files_of_one_name_are_refused_and_an_earlier_one_stays() {
        let folder = folder("twice");
        let mut output = Output::new(&folder).expect("writable");
        fs::write(folder.join("table"), "earlier").expect("written");
        let text = |file: &mut BufWriter<File>| file.write_all(b"later");
        output.write("table", text).expect("written");
        let again = folder.join("..").join(folder.file_name().expect("named")).join("table");
        assert!(is_same_file(&again, &folder.join("table")));
        let error = output.write_at(&again, text).expect_err("written before").to_string();
        assert!(error.contains("table: "), "{error}");
        output.write("other", text).expect("written");
        drop(output);
        assert_eq!(fs::read(folder.join("table")).expect("there"), b"earlier");
        assert_eq!(names(&folder), ["table"]);
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

    #[cfg(unix)]
    #[test]
    fn links_and_pipes_stay_what_they_are() {
        use std::os::unix::fs::{FileTypeExt, symlink};
        let folder = folder("links");
        fs::create_dir_all(&folder).expect("made");
        let text = |file: &mut BufWriter<File>| file.write_all(b"later");

        let (file, link) = (folder.join("file"), folder.join("link"));
        fs::write(&file, "earlier").expect("written");
        symlink(&file, &link).expect("linked");
        write_file(&link, text).expect("written");
        assert!(fs::symlink_metadata(&link).expect("there").is_symlink());
        assert_eq!(fs::read(&file).expect("there"), b"later");
        symlink(folder.join("nowhere"), folder.join("broken")).expect("linked");
        assert!(write_file(&folder.join("broken"), text).is_err());

        // A pipe stands for devices, which a test that fails would replace.
        let pipe = folder.join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo");
        assert!(made.success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe)
        });
        write_file(&pipe, text).expect("written");
        assert!(fs::metadata(&pipe).expect("there").file_type().is_fifo());
        assert_eq!(reader.join().expect("no panic").expect("readable"), b"later");
        let mut found = names(&folder);
        found.sort_unstable();
        assert_eq!(found, ["broken", "file", "link", "pipe"]);
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
