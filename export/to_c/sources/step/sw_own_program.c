/* The control step with the parameters that are compiled in. */
#include "stillwake.h"
#include "sw_weights.h"

sw_status sw_input_reset(sw_input *input)
{
    const sw_program own = SW_OWN_PROGRAM;
    return sw_input_reset_of(&own, input);
}

sw_status sw_control_step(sw_workspace *work, const sw_input *input, sw_output *output)
{
    const sw_program own = SW_OWN_PROGRAM;
    return sw_control_step_of(&own, work, input, output);
}

sw_status sw_known_answer(sw_workspace *work, sw_input *input, sw_output *output)
{
    const sw_program own = SW_OWN_PROGRAM;
    return sw_known_answer_of(&own, work, input, output);
}
