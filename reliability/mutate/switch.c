/* The number of the mutant that the process runs, 0 for none, and which ones it has reached. All extensions of a
   mutated build are linked with this library, so a process has one of each. */

#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

int tf2_mutant = 0;
static unsigned char not_asked_for[MUTANTS];
unsigned char *tf2_mutants_reached = not_asked_for;

__attribute__((constructor)) static void begin(void) {
    const char *number = getenv("TF2_MUTANT");
    const char *reached = getenv("TF2_MUTANTS_REACHED"); /* a file of MUTANTS bytes that processes share */
    int file;
    void *mapped;
    if (number != NULL)
        tf2_mutant = atoi(number);
    if (reached == NULL || (file = open(reached, O_RDWR)) < 0)
        return;
    mapped = mmap(NULL, MUTANTS, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (mapped != MAP_FAILED)
        tf2_mutants_reached = mapped;
    close(file);
}
