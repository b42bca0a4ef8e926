//! Tables of form factors.

use std::io::{self, Write};

use ndarray::ArrayView2;
use ndarray_npy::WriteNpyExt;

use super::matrix::Matrix;
use crate::csv::quoted;

/// A line for each group with its name, its area, its emissivity, its factors, and what these lack to 1.
///
/// # Errors
/// Those of `file`.
pub(crate) fn csv(file: &mut impl Write, matrix: &Matrix) -> io::Result<()> {
    let names: Vec<String> = matrix.groups.iter().map(|group| quoted(&group.name)).collect();
    writeln!(file, "name,area,emissivity,{},rest", names.join(","))?;
    let count = names.len();
    for (k, name) in names.iter().enumerate() {
        let row = &matrix.factors[k * count..][..count];
        let area = matrix.groups[k].area;
        write!(file, "{name},{area},{}", matrix.emissivity(k))?;
        row.iter().try_for_each(|factor| write!(file, ",{factor:.6e}"))?;
        writeln!(file, ",{:.6e}", 1.0 - row.iter().sum::<f64>())?;
    }
    Ok(())
}

/// A line for each factor of at least so much.
///
/// # Errors
/// Those of `file`.
pub(crate) fn sparse(file: &mut impl Write, matrix: &Matrix, least: f64) -> io::Result<()> {
    writeln!(file, "from,to,factor")?;
    let names: Vec<String> = matrix.groups.iter().map(|group| quoted(&group.name)).collect();
    for (k, factor) in matrix.factors.iter().enumerate().filter(|(_, factor)| **factor >= least) {
        let [from, to] = [&names[k / names.len()], &names[k % names.len()]];
        writeln!(file, "{from},{to},{factor:.6e}")?;
    }
    Ok(())
}

/// The factors alone.
///
/// # Errors
/// Those of `file`.
pub(crate) fn npy(file: &mut impl Write, matrix: &Matrix) -> io::Result<()> {
    let shape = [matrix.groups.len(); 2];
    let view = ArrayView2::from_shape(shape, &matrix.factors).map_err(io::Error::other)?;
    view.write_npy(file).map_err(io::Error::other)
}

/// The file that View3D writes: its controls, areas, factors and emissivities.
///
/// # Errors
/// Those of `file`.
pub(crate) fn view3d(
    file: &mut impl Write,
    matrix: &Matrix,
    [out, encl, emit]: [u32; 3],
) -> io::Result<()> {
    let count = matrix.groups.len();
    let joined = |numbers: Vec<String>| numbers.join(" ");
    writeln!(file, "View3D 3.3 {out} {encl} {emit} {count}")?;
    // As many digits as single precision has.
    let area = |area: f64| format!("{area:.6e}").parse::<f64>().unwrap_or(area).to_string();
    writeln!(file, "{}", joined(matrix.groups.iter().map(|group| area(group.area)).collect()))?;
    for row in matrix.factors.chunks(count.max(1)) {
        writeln!(file, "{}", joined(row.iter().map(|factor| format!("{factor:.6}")).collect()))?;
    }
    let emissivity = |k: usize| format!("{:.3}", matrix.emissivity(k));
    writeln!(file, "{}", joined((0..count).map(emissivity).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factors::groups::Group;

    #[test]
    fn tables_have_names_factors_and_what_rows_lack() {
        let group = |name: &str, area| Group { name: name.to_owned(), area, emitting: 0.5 * area };
        let groups = vec![group("a,b", 2.0), group("c", 1.0)];
        let matrix = Matrix { groups, factors: vec![0.0, 0.25, 0.5, 0.0] };
        let text = |write: &dyn Fn(&mut Vec<u8>) -> io::Result<()>| {
            let mut file = Vec::new();
            write(&mut file).expect("written");
            String::from_utf8(file).expect("text")
        };
        let whole = text(&|file| csv(file, &matrix));
        let expected = "name,area,emissivity,\"a,b\",c,rest\n\
            \"a,b\",2,0.5,0.000000e0,2.500000e-1,7.500000e-1\n\
            c,1,0.5,5.000000e-1,0.000000e0,5.000000e-1\n";
        assert_eq!(whole, expected);
        let some = text(&|file| sparse(file, &matrix, 0.3));
        assert_eq!(some, "from,to,factor\nc,\"a,b\",5.000000e-1\n");
        let theirs = text(&|file| view3d(file, &matrix, [1, 0, 0]));
        let expected =
            "View3D 3.3 1 0 0 2\n2 1\n0.000000 0.250000\n0.500000 0.000000\n0.500 0.500\n";
        assert_eq!(theirs, expected);
    }
}
