//! Decodes image messages: colour to grey and RGB, depth to metres.

mod bayer;
pub(crate) mod colour;
pub(crate) mod depth;
mod yuv;

pub(crate) use colour::{Colour, colour, compressed_colour, stated_size};
pub(crate) use depth::{compressed_depth, depth};

use stillpoint_datasets::MOST_PIXELS;

/// Expected and found, for an image that cannot be decoded.
#[derive(Debug, PartialEq)]
pub(crate) struct Bad {
    pub(crate) expected: String,
    pub(crate) found: String,
}

impl Bad {
    pub(crate) fn new(expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self {
            expected: expected.into(),
            found: found.into(),
        }
    }
}

type Result<T> = std::result::Result<T, Bad>;

/// Rows of an image without padding: `row` bytes of every `step`; a step of 0 means no padding.
fn rows(data: &[u8], height: u32, step: u32, row: usize) -> Result<impl Iterator<Item = &[u8]>> {
    let (step, height) = (step as usize, height as usize);
    let step = if step == 0 { row } else { step };
    // The last row may lack its padding.
    let needed = step
        .checked_mul(height.saturating_sub(1))
        .and_then(|n| n.checked_add(row));
    if height == 0 || row == 0 || step < row || needed.is_none_or(|n| n > data.len()) {
        return Err(Bad::new(
            format!("{height} rows of {row} bytes"),
            format!("{} bytes in rows of {step}", data.len()),
        ));
    }
    Ok(data.chunks(step).take(height).map(move |r| &r[..row]))
}

fn size(width: u32, height: u32) -> Result<(usize, usize)> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MOST_PIXELS {
        let found = format!("{width} x {height} px");
        let expected = format!("an image of 1 to {MOST_PIXELS} pixels");
        return Err(Bad::new(expected, found));
    }
    Ok((width as usize, height as usize))
}
