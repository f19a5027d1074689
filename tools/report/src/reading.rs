//! How to read the report: the method and its limits.

use fit::Method;
use maud::{Markup, html};

/// The whole section but its heading.
pub fn reading(method: Method) -> Markup {
    html! {
        p {
            strong { "Method. " }
            "The tissue under each of eight regions is an ellipsoid with radii A, B and C pressed against the ground. Contact \
             area gives its deformation (Eq. 14; the rate by Eq. 16, with the factor ½ that Eq. 15 lacks in print), and \
             deformation gives force by a stiffness and a damping that rise with it (Eqs. 5, 6 and 13). The parameters are \
             those with the least squares between model and measured force over the contact (Eq. 18, each step over its peak)."
            @match method {
                Method::Projection =>
                    " Tensile force is cut rather than penalised as in Eq. 19, and π A B is at least the largest area.",
                Method::Paper =>
                    " All eight were searched as in the paper, with the penalty of Eq. 19; π A B may be less than the largest area.",
            }
        }
        p {
            strong { "What is identifiable. " }
            "Of the paper's eight parameters (Eq. 17) a force trace tells five: the product A B, the exponents n and m, and"
            " K = k C" sup { "n+1" } " / d₀" sup { "n" } " and G = c C" sup { "m+1" } " / d₀" sup { "m" }
            ". The force is the same for every A/B, C and d₀ once the others follow. "
            @match method {
                Method::Projection =>
                    "These three come from elsewhere: A/B from the measured contact ellipse, d₀ from the thickness entered, C \
                     from the peak compression; A, B, C, d₀, k and c hold only together with these pins. ",
                Method::Paper => "Where the search left these three is chance. ",
            }
            "Compare people by the five."
        }
        p {
            strong { "Intervals. " }
            "Jacobian: what the scatter of force around the model leaves open, were it independent from sample to sample. \
             Resampled: the middle 95 % of fits to steps drawn again; it has what differs from step to step. Where they \
             disagree trust the wider one."
        }
        p {
            strong { "Errors. " }
            "NRMSE is the root mean square of model minus measured force over the region's largest measured force (Eq. 20). "
            em { "Fitted" } ": one set of parameters for all steps. "
            em { "Own" } ": parameters of each step alone, as the paper scores. "
            em { "Predicted" } ": parameters from the other steps; the honest one for a new step. "
            em { "Floor" } ": the best rising function of area, so no elastic law of this area does better; damping can. "
            em { "Raw" } " is against force as measured, " em { "smoothed" } " against force through a fifth-order polynomial."
        }
        p {
            strong { "Limits. " }
            "Area depends on the contact threshold and on the cells: parameters of another rule or sensor are not comparable. \
             Force is normal force only. The eight regions are a convention for comparing feet, not anatomy. \
             This is not a medical device; it diagnoses nothing."
        }
        p {
            strong { "Source. " }
            cite {
                "J. DeBerardinis, J. S. Dufek, M. B. Trabia, "
                "Journal of Biomechanics 92 (2019) 137–145."
            }
            " Its errors shown here as reference are those of its Table 2: the right foot of one participant."
        }
    }
}
