"""Which mutant the process runs; mutated sources cimport this, and no other module does."""

cdef extern from *:
    """
    extern int tf2_mutant;
    extern unsigned char* tf2_mutants_reached;
    #define TF2_MUTANT(number) (tf2_mutants_reached[number] = 1, tf2_mutant == (number))
    """
    # Whether the process runs this mutant; notes that it was asked.
    bint mutated "TF2_MUTANT"(int number) noexcept nogil
