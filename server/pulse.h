/* pulse.h - whether an event loop of libmicrohttpd still answers: asked over a private connection.
 *
 * The connection is one end of a pair of sockets that is handed to the daemon; the other end is ours. It
 * takes no place in the backlog and no address, so that nobody outside can ask or get in the way.
 *
 * new, free, tick and answers: by one thread. answered_ms: by any. The last three: by the loop. */
#ifndef DRAPED_PULSE_H
#define DRAPED_PULSE_H

#include <stdbool.h>
#include <stdint.h>

#include <microhttpd.h>

struct pulse;

struct pulse *pulse_new(void);                 /* NULL when out of memory */
struct pulse *pulse_free(struct pulse *pulse); /* NULL is fine; after the daemon has stopped */

/* Takes the answer to the last question, and asks the next. */
void pulse_tick(struct pulse *pulse, struct MHD_Daemon *daemon);

int64_t pulse_answered_ms(const struct pulse *pulse); /* monotonic; at first the time of pulse_new */
unsigned pulse_answers(const struct pulse *pulse);    /* so far */

/* For MHD_OPTION_NOTIFY_CONNECTION and the request handler of the daemon: whether this is the private
 * connection, of which nobody else may take notice, and what to say on it. */
bool pulse_connection(struct pulse *pulse, struct MHD_Connection *mhd, void **socket_context,
                      enum MHD_ConnectionNotificationCode code);
bool pulse_is_mine(const struct pulse *pulse, struct MHD_Connection *mhd);
enum MHD_Result pulse_answer(struct MHD_Connection *mhd);

#endif
