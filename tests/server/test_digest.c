/* test_digest.c - Content-Digest: what agrees, what does not, and what is no such header. */
#include "test.h"

#include "digest.h"

/* RFC 9530, appendix D: of {"hello": "world"} and a line feed. */
#define BODY    "{\"hello\": \"world\"}\n"
#define SHA_256 "sha-256=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg=:"
#define SHA_512                                                                                              \
    "sha-512=:YMAam51Jz/jOATT6/zvHrLVgOYTGFy1d6GJiOHTohq4yP+pgk4vf2aCsyRZOtw8MjkM7iw7yZ/WkppmM44T3qg==:"

static enum problem_code check(const char *header)
{
    struct problem problem = {0};
    int rc = digest_check(header, BODY, sizeof BODY - 1, &problem);
    assert_int_equal(rc, problem.code == PROBLEM_NONE ? 0 : -1);
    return problem.code;
}

static void test_digest__a_body_that_agrees_is_taken(void **state)
{
    (void)state;
    assert_int_equal(check(NULL), PROBLEM_NONE);
    assert_int_equal(check(SHA_256), PROBLEM_NONE);
    assert_int_equal(check(SHA_512), PROBLEM_NONE);
    assert_int_equal(check(SHA_512 ", " SHA_256), PROBLEM_NONE);
    assert_int_equal(check(SHA_512 "\t,\t" SHA_256 " "), PROBLEM_NONE);
}

static void test_digest__one_that_differs_is_refused_whatever_else_agrees(void **state)
{
    (void)state;
    static const char other[] = "sha-256=:AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=:";
    struct problem problem = {0};
    assert_int_equal(check(other), PROBLEM_DIGEST_MISMATCH);
    assert_int_equal(check(SHA_512 ", "
                                   "sha-256=:AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=:"),
                     PROBLEM_DIGEST_MISMATCH);
    assert_int_equal(digest_check(SHA_256, "x", 1, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_DIGEST_MISMATCH);
    digest_check(other, BODY, sizeof BODY - 1, &problem);
    assert_non_null(strstr(problem.detail, "RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg="));
}

static void test_digest__algorithms_not_known_are_passed_over(void **state)
{
    (void)state;
    assert_int_equal(check("md5=:Sd/dVLAcvNLSq16eXua5uQ==:"), PROBLEM_NONE);
    assert_int_equal(check("md5=:xx:, " SHA_256), PROBLEM_NONE);
}

static void test_digest__what_is_no_list_is_refused(void **state)
{
    (void)state;
    const char *bad[] = {"",
                         " ",
                         ",",
                         "sha-256",
                         "sha-256=",
                         "sha-256=:",
                         "sha-256=::",
                         "sha-256=RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg=",
                         "sha-256=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg:",   /* no padding */
                         "sha-256=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg==:", /* too much */
                         "sha-256=:RK_0qy18MlBSVnWgjwz6lZEWjP_lF5HF9bvEF8FabDg=:",  /* the other alphabet */
                         "sha-256=:RK/0:",
                         "sha-512=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg=:",
                         SHA_256 ",",
                         SHA_256 " " SHA_512,
                         SHA_256 ";q=1",
                         SHA_256 "x",
                         "SHA-256"
                         "=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg=:"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (check(bad[i]) != PROBLEM_BAD_REQUEST)
            fail_msg("\"%s\" was not refused as malformed", bad[i]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_digest__a_body_that_agrees_is_taken),
        cmocka_unit_test(test_digest__one_that_differs_is_refused_whatever_else_agrees),
        cmocka_unit_test(test_digest__algorithms_not_known_are_passed_over),
        cmocka_unit_test(test_digest__what_is_no_list_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
