//! What is said of the end of a push that was fitted, and how certain it is.
//!
//! What is said follows the parameters of the fit and the numbers of part and motion that are not known (J C Jᵀ). Where
//! the cost has a valley that bends, the valley's ends take the place of its direction; where it has none, a pose is still
//! widened by how the surface of poses bends on which one edge is in contact.
//!
//! Units: SI. Errors: none is told of an end that cannot be played.

use std::ops::AddAssign as _;

use nalgebra::{
    DMatrix, DVector, Isometry2, Matrix2, Matrix3, Matrix4, Matrix6, SMatrix, SVector, Vector2, Vector3, Vector4,
};

use super::fit::{Around, COLUMNS, DELAY, MU_C, MU_G, PARAMETERS, Problem, SHARE_OF_SD, Tried, spread, volume};
use super::numbers::NumberedMinimum;
use super::path::{Course, Guess, Path};
use super::samples::Sampled;
use super::valley::{Valley, change};
use crate::math::covariance::wider;
use crate::math::unscented::Gaussian;
use crate::pushing::dynamics::State;
use crate::search::Halt;

/// Numbers of a push under way: u, s, ω, how it slides, µ_c, ln of µ g over what it is taken for, ln of the mass, and by how
/// much the finger's effective mass is off what it is taken for.
pub(super) const BELIEF: usize = 8;
/// Where among them the angular velocity is.
pub(super) const BELIEF_OMEGA: usize = 2;
/// By how much v_T is off that of a part that rolls.
pub(super) const BELIEF_SLIDE: usize = 3;
/// µ_c.
pub(super) const BELIEF_MU_C: usize = 4;
/// ln(µ g).
pub(super) const BELIEF_MU_G: usize = 5;
/// ln m.
pub(super) const BELIEF_MASS: usize = 6;
/// The finger's effective mass.
pub(super) const BELIEF_FINGER: usize = 7;

/// What is said of the end: x, y, θ, velocity of the centre of mass, ω; then u, s, v_T; then the friction that rolling took.
const SAID: usize = 10;

/// How many of them are pose and motion.
const MOTION: usize = 6;

/// Where among them the state is: u, s, ω, v_T.
const STATE: [usize; 4] = [6, 7, 5, 8];

/// Where the friction that rolling took is.
const NEEDED: usize = 9;

/// Differences of contact angle (rad) and place (m) that stand for second derivatives of a pose.
const SECOND_DIFFERENCES: [f64; 2] = [1e-3, 1e-4];

/// Friction that rolling took is stated less so many standard deviations.
const NEEDED_SDS: f64 = 3.0;

type Said = SVector<f64, SAID>;

/// What is uncertain at the end of a fit.
pub(super) struct EndCovariance {
    /// Of x, y, θ.
    pub(super) pose: Matrix3<f64>,
    /// Of x, y, θ, velocity of the centre of mass, ω.
    pub(super) motion: Matrix6<f64>,
    /// Of u, s, ω, v_T.
    pub(super) state: Matrix4<f64>,
    /// Square root of the determinant for contact angle and place at the start.
    pub(super) spread: f64,
    /// Of the parameters, as samples say, where that which slopes say is 1.
    pub(super) sampled_volume: f64,
    /// Standard deviation of µ_c, where the contact slipped.
    pub(super) mu_c_sd: Option<f64>,
    /// Friction that rolling took, at the least.
    pub(super) friction_needed: f64,
    /// Standard deviation of ln(µ g); 0 where it is known.
    pub(super) mu_g_log_sd: f64,
    /// Of the mass's logarithm.
    pub(super) mass_log_sd: f64,
    /// Of the logarithm of their product.
    pub(super) resistance_log_sd: f64,
}

/// How far a minimum reaches is seen.
#[derive(Clone, Copy)]
pub(super) enum Reach<'a> {
    /// By slopes.
    Slopes,
    /// By them, and along a valley that bends, which takes as long as the fit.
    Valley(&'a Halt<'a>),
    /// By slopes, along a valley that bends, and by minima of what might have been felt instead: the widest of these.
    Sampled(&'a Sampled),
}

/// What slopes say counts as so many samples.
const SLOPES_COUNT: f64 = 4.0;

/// Second moments about a minimum: of samples, and of what slopes say as of so many more.
struct Moments<const N: usize> {
    mean: SMatrix<f64, N, N>,
    /// Few samples tell a covariance in which a truth is further off than on average (Wishart): by this factor in its squares.
    few: f64,
}

impl<const N: usize> Moments<N> {
    fn of(slopes: SMatrix<f64, N, N>, samples: impl Iterator<Item = SVector<f64, N>>) -> Self {
        let (sum, count) =
            samples.fold((SMatrix::zeros(), 0.0), |(sum, count), off| (sum + off * off.transpose(), count + 1.0));
        if count < SLOPES_COUNT {
            return Self { mean: slopes, few: 1.0 };
        }
        let all = SLOPES_COUNT + count;
        Self { mean: (slopes * SLOPES_COUNT + sum) / all, few: all / count }
    }

    fn covariance(&self) -> SMatrix<f64, N, N> {
        self.mean * self.few
    }
}

impl<'p> Problem<'_, 'p> {
    /// What is uncertain at the end, everything that is not known included: parameters, part, motion, and what adds to the
    /// force; how far the minimum reaches being seen as `reach` says.
    pub(super) fn end_covariance(&self, around: &Around, reach: Reach<'_>) -> Option<EndCovariance> {
        let (at, course) = (around.at, self.course.sure());
        let AboutEnd { end, parameters, of_end } = self.about_end(around, &course)?;
        let needed_sd = of_end.covariance[(NEEDED, NEEDED)].max(0.0).sqrt();
        let mut all = parameters.fixed_view::<COLUMNS, COLUMNS>(0, 0).into_owned();
        let mut said = of_end.covariance;
        // What the surface of poses bends by along all directions but the valley's, which is followed there.
        let mut straight = said;
        let walked = match reach {
            Reach::Valley(halt) => Valley::through(self, at, &parameters, &of_end.of_state(), halt),
            Reach::Slopes | Reach::Sampled(_) => None,
        };
        let valley = match reach {
            Reach::Sampled(sampled) => sampled.valley.as_ref(),
            Reach::Slopes | Reach::Valley(_) => walked.as_ref(),
        };
        let mut by_slopes = (all, said);
        if let Some(valley) = valley {
            all = valley.covered(all, valley.straight, |place| Some(place.parameters));
            let taken = self.taken_of_nuisances(at);
            let along = of_end.slopes * valley.straight;
            straight -= along * along.transpose();
            said = valley.covered(said, along, |place| {
                // Along the valley the numbers are found anew, too.
                let there = &place.there;
                let more = DVector::from_vec(self.taken_of_nuisances(there)) - DVector::from_column_slice(&taken);
                let of_numbers = (&of_end.of_nuisances * more).fixed_view::<SAID, 1>(0, 0).into_owned();
                Some(end.to_that_of(&course, &there.guess, &there.path)? + of_numbers)
            });
        }
        let [u, s, ..] = STATE;
        let contact = Matrix2::new(straight[(u, u)], straight[(u, s)], straight[(s, u)], straight[(s, s)]);
        let bent = self.bent_away(at, &contact)?;
        for said in [&mut said, &mut by_slopes.1] {
            said.fixed_view_mut::<3, 3>(0, 0).add_assign(&bent);
        }
        let mut sampled_volume = 1.0;
        if let Reach::Sampled(Sampled { samples, .. }) = reach {
            let told = |sample: &NumberedMinimum| {
                end.to_that_of(&sample.numbered.course(self.course), &sample.tried.guess, &sample.tried.path)
            };
            let of_parameters = Moments::of(by_slopes.0, samples.iter().map(|sample| change(at, &sample.tried)));
            let of_end = Moments::of(by_slopes.1, samples.iter().filter_map(told));
            let volumes = volume(&of_parameters.mean).zip(volume(&by_slopes.0));
            sampled_volume = volumes.map_or(1.0, |(of_samples, of_slopes)| of_samples / of_slopes);
            // Slopes tell of the lowest place alone, few samples come far along a valley that bends, and what a walk holds may
            // bend, too: what any of them shows is open.
            all = wider(&wider(&by_slopes.0, &all), &of_parameters.covariance());
            said = wider(&wider(&by_slopes.1, &said), &of_end.covariance());
        }
        let deviation = |parameter: usize| all[(parameter, parameter)].max(0.0).sqrt();
        let (mu_g_log_sd, mass_log_sd) = (deviation(MU_G), deviation(PARAMETERS));
        // Variance of ln(µ g) + ln m, which a slow push feels as one number.
        let weight_variance = deviation(MU_G).powi(2) + deviation(PARAMETERS).powi(2) + 2.0 * all[(MU_G, PARAMETERS)];
        Some(EndCovariance {
            mu_c_sd: at.path.slipped.then(|| deviation(MU_C)),
            friction_needed: (at.path.friction_needed - NEEDED_SDS * needed_sd).max(0.0),
            mu_g_log_sd,
            mass_log_sd,
            resistance_log_sd: weight_variance.max(0.0).sqrt(),
            pose: said.fixed_view::<3, 3>(0, 0).into_owned(),
            motion: said.fixed_view::<MOTION, MOTION>(0, 0).into_owned(),
            state: Matrix4::from_fn(|row, column| said[(STATE[row], STATE[column])]),
            spread: spread(&all.fixed_view::<2, 2>(0, 0).into_owned()),
            sampled_volume,
        })
    }

    /// The valley of a minimum, where it bends.
    pub(super) fn valley(&self, at: &Tried, halt: &Halt<'_>) -> Option<Valley> {
        let AboutEnd { parameters, of_end, .. } = self.about_end(&self.around(at), &self.course.sure())?;
        Valley::through(self, at, &parameters, &of_end.of_state(), halt)
    }

    /// The end of a minimum of a course, and how it follows the parameters.
    fn about_end(&self, around: &Around, course: &Course<'p>) -> Option<AboutEnd> {
        let end = End::of(course, &around.at.guess, &around.at.path)?;
        let to = |course: &Course<'p>, guess: &Guess, path: &Path| end.to_that_of(course, guess, path);
        let parameters = self.covariance(around)?;
        let of_end = self.of_end(around, to, &SMatrix::zeros(), None, &parameters)?;
        Some(AboutEnd { end, parameters, of_end })
    }

    /// Second moments of what slopes leave out of the pose at the end (x, y, θ), for a covariance of contact angle and
    /// place there: poses with one edge in contact lie on a surface that bends, and what is hardly known is far along it.
    fn bent_away(&self, at: &Tried, contact: &Matrix2<f64>) -> Option<Matrix3<f64>> {
        let course = self.course.sure();
        let there = |u: f64, s: f64| {
            let end = State { u: at.path.end.u + u, s: at.path.end.s + s, ..at.path.end };
            course.pose_of_end(&at.guess, &end)
        };
        let here = there(0.0, 0.0)?;
        let to = |u: f64, s: f64| Some(difference(&here, &there(u, s)?));
        let [h_u, h_s] = SECOND_DIFFERENCES;
        let second_u = (to(h_u, 0.0)? + to(-h_u, 0.0)?) / (h_u * h_u);
        let both = (to(h_u, h_s)? + to(-h_u, -h_s)? - to(h_u, -h_s)? - to(-h_u, h_s)?) / (4.0 * h_u * h_s);
        // Straight along an edge, and bent along an ellipse.
        let second_s = (to(0.0, h_s)? + to(0.0, -h_s)?) / (h_s * h_s);
        let (uu, us, ss) = (contact[(0, 0)], contact[(0, 1)], contact[(1, 1)]);
        // x = ½ a u² + b u s + ½ c s² of a normal (u, s): E[u⁴] = 3 uu², E[u³ s] = 3 uu us, E[u² s²] = uu ss + 2 us².
        let product = |a: &Vector3<f64>, b: &Vector3<f64>| a * b.transpose();
        Some(
            product(&second_u, &second_u) * (0.75 * uu * uu)
                + (product(&second_u, &both) + product(&both, &second_u)) * (1.5 * uu * us)
                + product(&both, &both) * (uu * ss + 2.0 * us * us)
                + (product(&second_u, &second_s) + product(&second_s, &second_u)) * (0.25 * (uu * ss + 2.0 * us * us))
                + (product(&both, &second_s) + product(&second_s, &both)) * (1.5 * us * ss)
                + product(&second_s, &second_s) * (0.75 * ss * ss),
        )
    }

    /// State and unknown numbers at the end, as one who follows the push goes on from them.
    /// For the contact angle at the start within so much of what it is there, rad.
    pub(super) fn belief_at_end(&self, around: &Around, effective_mass_sd: f64, u_sd: f64) -> Option<Gaussian<BELIEF>> {
        let (at, course) = (around.at, self.course.sure());
        let end = Self::followed_of(&course, &at.guess, &at.path)?;
        let to = |course: &Course<'p>, guess: &Guess, path: &Path| {
            let after = Self::followed_of(course, guess, path)? - end;
            Some(SVector::from_fn(|row, _| if row < 4 { after[row] } else { 0.0 }))
        };
        let mut own = SMatrix::<f64, BELIEF, COLUMNS>::zeros();
        own[(BELIEF_MU_C, MU_C)] = 1.0;
        own[(BELIEF_MU_G, MU_G)] = 1.0;
        own[(BELIEF_MASS, PARAMETERS)] = 1.0;
        let mut mean = SVector::<f64, BELIEF>::zeros();
        mean.fixed_rows_mut::<4>(0).copy_from(&end);
        mean[BELIEF_MU_C] = at.guess.mu_c;
        mean[BELIEF_MU_G] = at.guess.mu_g_log;
        mean[BELIEF_MASS] = at.mass.ln();
        mean[BELIEF_FINGER] = effective_mass_sd * self.taken_beside(at);
        let of_beside = SVector::from_fn(|row, _| if row == BELIEF_FINGER { effective_mass_sd } else { 0.0 });
        let parameters = self.covariance_near(around, u_sd)?;
        let covariance = self.of_end(around, to, &own, Some(of_beside), &parameters)?.covariance;
        Some(Gaussian { mean, covariance })
    }

    /// u, s, ω and how it slides at the end.
    fn followed_of(course: &Course<'p>, guess: &Guess, path: &Path) -> Option<Vector4<f64>> {
        Some(Vector4::new(path.end.u, path.end.s, path.end.omega, course.slide_at_end(guess, path)?))
    }

    /// How what is said of the end follows the parameters, and its covariance with everything that is not known: `to` is how
    /// that of another push differs, `own` what follows the parameters whatever the push does, `of_beside` the same for
    /// a standard deviation of what adds to the force.
    fn of_end<const N: usize>(
        &self,
        around: &Around,
        to: impl Fn(&Course<'p>, &Guess, &Path) -> Option<SVector<f64, N>>,
        own: &SMatrix<f64, N, COLUMNS>,
        of_beside: Option<SVector<f64, N>>,
        parameters: &DMatrix<f64>,
    ) -> Option<OfEnd<N>> {
        let (at, course) = (around.at, self.course.sure());
        let nuisances: Vec<_> = at.predicted.nuisances(at.mass).collect();
        let mut of_end = *own;
        for column in (0..PARAMETERS).filter(|&column| column != DELAY && self.is_free(at, column)) {
            let (step, there) = around.neighbours[column].as_ref()?;
            of_end.column_mut(column).add_assign(&(to(&course, &there.guess, &there.path)? / *step));
        }
        let parameters = parameters.fixed_view::<COLUMNS, COLUMNS>(0, 0).into_owned();
        if nuisances.is_empty() {
            let covariance = of_end * parameters * of_end.transpose();
            return Some(OfEnd { alone: of_end, slopes: of_end, of_nuisances: DMatrix::zeros(N, 0), covariance });
        }
        let mut of_nuisances = vec![SVector::<f64, N>::zeros(); nuisances.len()];
        for (changed, of_nuisance) in self.course.changed.iter().zip(&mut of_nuisances) {
            let course = course.with(changed);
            let there = course.play(&at.guess).ok().and_then(|path| to(&course, &at.guess, &path));
            *of_nuisance = there.map_or_else(SVector::zeros, |there| there / SHARE_OF_SD);
        }
        let beside = of_nuisances.iter_mut().skip(self.course.changed.len()).zip(of_beside);
        beside.for_each(|(of_nuisance, of_beside)| *of_nuisance = of_beside);
        // J C Jᵀ, nuisances eliminated: what they are for given parameters, and what that leaves open.
        let columns = DMatrix::from_columns(&nuisances);
        let curvature = columns.tr_mul(&columns) + DMatrix::identity(columns.ncols(), columns.ncols());
        let curvature = curvature.cholesky()?;
        let of_nuisances = DMatrix::from_fn(N, of_nuisances.len(), |row, column| of_nuisances[column][row]);
        // Residuals are data less prediction: the nuisances' slopes have the other sign.
        let across = columns.tr_mul(&around.slopes.rows(0, columns.nrows()));
        let slopes = of_end + (&of_nuisances * curvature.solve(&across)).fixed_view::<N, COLUMNS>(0, 0);
        let open = &of_nuisances * curvature.solve(&of_nuisances.transpose());
        let covariance = slopes * parameters * slopes.transpose() + open.fixed_view::<N, N>(0, 0);
        Some(OfEnd { alone: of_end, slopes, of_nuisances, covariance })
    }
}

/// What is said of the end.
struct OfEnd<const N: usize> {
    /// Its derivatives by the parameters and the mass's logarithm, all else staying what it is.
    alone: SMatrix<f64, N, COLUMNS>,
    /// The same, all else being the best for these.
    slopes: SMatrix<f64, N, COLUMNS>,
    /// By a standard deviation of each of [`Predicted::nuisances`](super::felt::Predicted::nuisances).
    of_nuisances: DMatrix<f64>,
    covariance: SMatrix<f64, N, N>,
}

impl OfEnd<SAID> {
    /// Derivatives of u, s, ω, v_T by the parameters, all else staying what it is.
    fn of_state(&self) -> SMatrix<f64, 4, PARAMETERS> {
        SMatrix::from_fn(|row, column| self.alone[(STATE[row], column)])
    }
}

/// The end of a minimum, and what it follows.
struct AboutEnd {
    end: End,
    /// Covariance of the parameters.
    parameters: DMatrix<f64>,
    /// How what is said of the end follows them.
    of_end: OfEnd<SAID>,
}

/// The end of a push.
struct End {
    /// Of the part frame.
    pose: Isometry2<f64>,
    /// Of the centre of mass.
    velocity: Vector2<f64>,
    state: State,
    friction_needed: f64,
}

impl End {
    fn of(course: &Course, guess: &Guess, path: &Path) -> Option<Self> {
        Some(Self {
            pose: course.pose_at_end(guess, path)?,
            velocity: course.velocity_at_end(guess, path)?,
            state: path.end,
            friction_needed: path.friction_needed,
        })
    }

    /// How that of another push differs.
    fn to_that_of(&self, course: &Course, guess: &Guess, path: &Path) -> Option<Said> {
        Some(self.to(&Self::of(course, guess, path)?))
    }

    /// How another differs.
    fn to(&self, other: &Self) -> Said {
        let pose = difference(&self.pose, &other.pose);
        let velocity = other.velocity - self.velocity;
        let State { u, s, omega, v_t } = other.state;
        let (u, s, omega, v_t) = (u - self.state.u, s - self.state.s, omega - self.state.omega, v_t - self.state.v_t);
        let needed = other.friction_needed - self.friction_needed;
        Said::from([pose.x, pose.y, pose.z, velocity.x, velocity.y, omega, u, s, v_t, needed])
    }
}

/// From one pose to another: x, y, θ.
pub(super) fn difference(from: &Isometry2<f64>, to: &Isometry2<f64>) -> Vector3<f64> {
    let shift = to.translation.vector - from.translation.vector;
    Vector3::new(shift.x, shift.y, from.rotation.angle_to(&to.rotation))
}
