//! Pictures as OpenEXR.

use std::io::{self, Seek, Write};

use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage};
use farfield_scenes::Rgb;

/// Writes a picture of so many columns and rows of radiances in linear RGB, row by row from the upper left
/// corner, in single precision.
///
/// # Errors
/// Those of `file`, and [`io::ErrorKind::InvalidInput`] unless there is a radiance for each pixel.
pub(crate) fn write(
    file: &mut (impl Write + Seek),
    [width, height]: [usize; 2],
    radiances: &[Rgb],
) -> io::Result<()> {
    if radiances.len() != width * height {
        let message = format!("{} radiances: expected {width} x {height}", radiances.len());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    }
    let channels = SpecificChannels::rgb(|place: Vec2<usize>| {
        let [r, g, b] = radiances[place.y() * width + place.x()].map(|band| band as f32);
        (r, g, b)
    });
    let image = Image::from_channels((width, height), channels);
    image.write().non_parallel().to_buffered(file).map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_scenes::Output;

    #[test]
    fn pictures_keep_every_radiance() {
        let folder = tempfile::tempdir().expect("a folder");
        let radiance = |k: usize| [0.1 * k as f64, -3.5e7, 1e-9];
        let radiances: Vec<Rgb> = (0..6).map(radiance).collect();
        let mut output = Output::new(folder.path()).expect("writable");
        output.write("p.exr", |file| write(file, [3, 2], &radiances)).expect("written");
        let error = output.write("q.exr", |file| write(file, [2, 2], &radiances));
        let error = error.expect_err("six pixels");
        assert!(error.to_string().contains("6 radiances: expected 2 x 2"), "{error}");
        drop(output);
        let mut output = Output::new(folder.path()).expect("writable");
        output.write("p.exr", |file| write(file, [3, 2], &radiances)).expect("written");
        output.publish().expect("renamed");
        let image = exr::prelude::read_first_rgba_layer_from_file(
            folder.path().join("p.exr"),
            |size, _| vec![[0.0f32; 3]; size.area()],
            |pixels, place, (r, g, b, _): (f32, f32, f32, f32)| {
                pixels[place.y() * 3 + place.x()] = [r, g, b];
            },
        );
        let found = image.expect("readable").layer_data.channel_data.pixels;
        let expected: Vec<_> = radiances.iter().map(|rgb| rgb.map(|band| band as f32)).collect();
        assert_eq!(found, expected);
    }
}
