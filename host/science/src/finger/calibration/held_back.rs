//! Contacts that the fit never sees, and what they say about it.
//!
//! Every k-th different angle is held back, counted round the disk, so that with the default plan (twelve contacts
//! every 30°, every fourth held back) they lie at 90°, 210° and 330°. Three angles a third of a turn apart see every
//! error a linear finger can have: a rotation of the axes shows equally in all, a stretch changes as the double angle,
//! which takes three different values there. Four at quarter turns would see only two of them.
//!
//! A contact is held back only if the others still span and, where loads are known, still hold a known one.

use super::fit::{CalibrationFit, ContactResult, FITTED_MIN, Role};
use super::measurements::{CalibrationContact, Load};
use super::span;
use crate::math::statistics::mean;

/// Angles nearer than this are one angle, rad (0.5°): repeated contacts are held back together or not at all.
const SAME_ANGLE: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// Which contacts to hold back.
pub(super) fn choose(contacts: &[CalibrationContact], every: usize) -> Vec<bool> {
    let mut held = vec![false; contacts.len()];
    if every < 2 {
        return held;
    }
    for group in distinct_angles(contacts).into_iter().skip(every - 1).step_by(every) {
        let before = held.clone();
        group.iter().for_each(|&index| held[index] = true);
        if !is_enough_without(contacts, &held) {
            held = before;
        }
    }
    held
}

/// Indices of the contacts at each different angle, in the order of the angles from 0 to 2π.
fn distinct_angles(contacts: &[CalibrationContact]) -> Vec<Vec<usize>> {
    let turned = |index: usize| (contacts[index].angle + SAME_ANGLE).rem_euclid(std::f64::consts::TAU);
    let mut order: Vec<usize> = (0..contacts.len()).collect();
    order.sort_by(|&a, &b| turned(a).total_cmp(&turned(b)));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for index in order {
        match groups.last_mut() {
            Some(group) if turned(index) - turned(group[0]) < SAME_ANGLE => group.push(index),
            _ => groups.push(vec![index]),
        }
    }
    groups
}

fn is_enough_without(contacts: &[CalibrationContact], held: &[bool]) -> bool {
    let rest: Vec<(f64, Load)> =
        contacts.iter().zip(held).filter(|(_, held)| !**held).map(|(c, _)| (c.angle, c.load)).collect();
    let known = |load: Load| matches!(load, Load::Newtons(_));
    let keeps_newtons = rest.iter().any(|(_, load)| known(*load)) || !contacts.iter().any(|c| known(c.load));
    rest.len() >= FITTED_MIN && keeps_newtons && span::span(&rest).is_enough()
}

/// What the held-back contacts say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldBack {
    /// How many contacts were kept out of the fit.
    pub contacts: usize,
    /// Mean of felt minus set angle, rad.
    pub mean_error: f64,
    /// Root of the mean square of the same, rad.
    pub rms_error: f64,
    /// The error of the worst, with its sign, rad.
    pub worst_error: f64,
    /// Contact angle of the worst, rad.
    pub worst_angle: f64,
    /// Standard deviation that noise, fixture and calibration let one expect of the worst, rad.
    pub worst_sigma: f64,
}

impl CalibrationFit {
    /// Judgement by the held-back contacts; `None` if there are none.
    #[must_use]
    pub fn held_back(&self) -> Option<HeldBack> {
        let held: Vec<&ContactResult> = self.contacts.iter().filter(|contact| contact.role == Role::HeldBack).collect();
        let worst = held.iter().max_by(|a, b| a.angle_error.abs().total_cmp(&b.angle_error.abs()))?;
        Some(HeldBack {
            contacts: held.len(),
            mean_error: mean(held.iter().map(|contact| contact.angle_error))?,
            rms_error: mean(held.iter().map(|contact| contact.angle_error.powi(2))).map(f64::sqrt)?,
            worst_error: worst.angle_error,
            worst_angle: worst.angle,
            worst_sigma: worst.angle_sigma,
        })
    }
}
