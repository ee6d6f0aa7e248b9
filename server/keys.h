/* keys.h - the names of API keys: whose a job or a mesh is. */
#ifndef DRAPED_KEYS_H
#define DRAPED_KEYS_H

#define KEY_NAME_SIZE 32 /* with its NUL; "": the daemon runs without keys */

#endif
