//! Instructions for reading the report: the method and its limitations.

use fit::{Method, Options};
use maud::{Markup, html};

/// The content of the section.
pub fn instructions(options: &Options) -> Markup {
    html! {
        p {
            strong { "Method. " }
            "The tissue of each of eight plantar regions is modelled as an ellipsoid with radii A, B and C that is pressed \
             against the ground. Its deformation follows from the contact area (Eq. 14) and its deformation rate from \
             differences over time (Eq. 16, or over the time that the filter in the section on the protocol states; Eq. 15 as \
             printed lacks a factor ½). The force follows from deformation and \
             rate with a stiffness and a damping that increase with deformation (Eqs. 5, 6 and 13). The parameters "
            @if options.method == Method::Projection && options.prior.is_some() {
                "are the most probable ones, given the squared differences between model and measured force over the contact \
                 (Eq. 18, each step normalised by its peak force) and the distribution of the parameters among ten walkers \
                 (prior)."
            } @else {
                "minimise the sum of squared differences between model and measured force over the contact (Eq. 18, each step \
                 normalised by its peak force)."
            }
            @match options.method {
                Method::Projection =>
                    " Tensile model force is set to zero instead of penalised as in Eq. 19, and π A B is constrained to be at \
                     least the largest contact area.",
                Method::Paper =>
                    " All eight parameters were searched as in the paper, for the measured force smoothed by a polynomial of \
                     fifth order, with the penalty of Eq. 19; π A B may be smaller than the largest contact area.",
            }
        }
        p {
            strong { "Identifiability. " }
            "Of the paper's eight parameters (Eq. 17), force and contact area determine five: the product A B, the exponents n \
             and m, and"
            " K = k C" sup { "n+1" } " / d₀" sup { "n" } " and G = c C" sup { "m+1" } " / d₀" sup { "m" }
            ". The ratio A/B, C and d₀ can be changed without a change of the force if the other parameters are adapted. "
            @match options.method {
                Method::Projection =>
                    "These three are fixed by other data: A/B by the contact ellipse within the borders of the region, d₀ by the \
                     thickness, C by a measured peak strain, a measured curvature of the unloaded sole, or an assumed \
                     compression. The values of A, B, C, d₀, k and c are valid only for these fixed values. ",
                Method::Paper => "The search determines these three arbitrarily. ",
            }
            "Compare people by the mechanical quantities. The force of this person does not determine the value of a parameter \
             with the mark †: "
            @if options.prior.is_some() {
                "it is close to the usual value of other people, is uncertain by a factor of more than 100, or has no meaning if \
                 G, and with it c, is 0."
            } @else {
                "it has no meaning."
            }
        }
        p {
            strong { "Intervals. " }
            "Jacobian: the 95 % interval from the scatter of the measured force about the model, corrected for the correlation of \
             successive samples"
            @if options.prior.is_some() {
                ", and from the distribution among people (prior); for a parameter with the mark †, mainly from the latter"
            }
            ". Resampled (bootstrap): the middle 95 % of the fits to steps drawn with \
             replacement; it includes the differences between steps. If the two disagree, use the wider one."
        }
        p {
            strong { "Errors. " }
            "NRMSE is the root mean square of model minus measured force, divided by the largest measured force of the region in \
             the step (Eq. 20). "
            em { "Fitted" } ": one set of parameters for all steps. "
            em { "Own" } ": parameters fitted to each step alone"
            @if options.prior.is_some() {
                " and, because one step contains little, drawn strongly to their distribution among people (prior): a step can have \
                 a smaller error with other parameters, also with those fitted to the other steps. "
            } @else {
                ", as in the paper. "
            }
            em { "Predicted" } ": parameters fitted to the other steps (cross-validation); the error to expect for a new step. "
            em { "Floor" } ": the error of the best non-decreasing function of contact area in each step. No elastic law \
             of this area has a smaller error; a law with damping can have a smaller error. "
            em { "Raw" } ": against the force as measured. "
            em { "Smoothed" } ": against the force smoothed by a polynomial of fifth order. "
            em { "Bias at peak" } ": the largest model force divided by the largest measured force, minus 1."
        }
        p {
            strong { "Limits. " }
            "Contact area depends on the contact threshold and on the size of the cells: parameters that were identified with \
             another contact rule or sensor are not comparable. If a cell counts with a fraction of its area, the sum is an \
             effective area, which also depends on the pressure. The measured force is the sum of the sensors: shear, and load \
             beside the sensors, are not part of it. \
             Deformations, and with them stiffness, moduli and energies, are scaled by assumption unless thickness and strain of the \
             tissue were measured. The eight regions are a convention for comparing feet, not anatomical structures. This is not a medical device; it must not be used for diagnosis."
        }
        p {
            strong { "Source. " }
            cite {
                "J. DeBerardinis, J. S. Dufek, M. B. Trabia, "
                "Journal of Biomechanics 92 (2019) 137–145."
            }
            " The errors shown for reference are those of its Table 2, for the right foot of one participant."
        }
    }
}
